# A training in a container. Not built where it was written: there was no daemon.
#
#   docker build -t col3d .
#   mkdir -p data runs
#   docker run --rm --user "$(id -u):$(id -g)" -v "$PWD/data:/col3d/data" -v "$PWD/runs:/col3d/runs" \
#     col3d preset=smoke
#   docker run --rm --user "$(id -u):$(id -g)" --gpus all --shm-size 4g -v /path/to/C3VD:/C3VD:ro \
#     -v "$PWD/runs:/col3d/runs" col3d preset=paper data=c3vd data.root=/C3VD
#
# It runs as a user, as that of the caller by --user, so that what it writes belongs to him. torch from PyPI brings
# CUDA's libraries, so that the default base trains on GPUs too (with the NVIDIA container toolkit). Another base has
# to have Python 3.11 as `python3`, and venv: --build-arg BASE=... Name it by its digest to have the same one again.
ARG BASE=python:3.11-slim
FROM ${BASE}

ENV PATH=/opt/venv/bin:$PATH PYTHONUNBUFFERED=1 HOME=/tmp
WORKDIR /col3d

# What the package depends on changes seldom: a layer of its own, every file of it checked by its hash.
COPY locks locks
RUN python3 -m venv /opt/venv \
 && pip install --no-cache-dir --require-hashes --no-deps -r locks/build.txt \
 && pip install --no-cache-dir --require-hashes --no-deps --no-build-isolation -r locks/train.txt

COPY pyproject.toml README.md LICENSE THIRD_PARTY_NOTICES.md ./
COPY src src
RUN pip install --no-cache-dir --no-deps --no-build-isolation -e .

RUN useradd --no-create-home col3d && mkdir data runs && chown col3d data runs
USER col3d

ENTRYPOINT ["col3d", "train"]
