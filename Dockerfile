# A training in a container. Not built where it was written: there was no daemon.
#
#   docker build -t col3d .
#   docker run --rm -v "$PWD/data:/col3d/data" -v "$PWD/runs:/col3d/runs" col3d preset=smoke
#   docker run --rm --gpus all --shm-size 4g -v /path/to/C3VD:/C3VD:ro -v "$PWD/runs:/col3d/runs" \
#     col3d preset=paper data=c3vd data.root=/C3VD
#
# torch from PyPI brings CUDA's libraries, so that the default base trains on GPUs too (with the NVIDIA container
# toolkit). Any base with Python 3.11 or newer as `python3`, and venv, will do: --build-arg BASE=nvidia/cuda:...
# For CPUs alone: --build-arg PIP_EXTRA_INDEX_URL=https://download.pytorch.org/whl/cpu
ARG BASE=python:3.11-slim
FROM ${BASE}

ARG PIP_EXTRA_INDEX_URL=
ENV PATH=/opt/venv/bin:$PATH PYTHONUNBUFFERED=1
WORKDIR /col3d

# What the package depends on changes seldom: a layer of its own.
COPY pyproject.toml constraints.txt README.md LICENSE THIRD_PARTY_NOTICES.md ./
RUN mkdir -p src/col3d && touch src/col3d/__init__.py \
 && python3 -m venv /opt/venv \
 && pip install --no-cache-dir -c constraints.txt -e .

COPY src src
COPY conf conf
COPY launch launch
COPY *.py ./

ENTRYPOINT ["python", "train.py"]
