"""A SLURM cluster of this machine alone, by Debian's packages slurm-wlm and munge; needs root."""

import os
import shutil
import socket
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

CONFIGURATION = """
ClusterName=col3d
SlurmctldHost={host}(127.0.0.1)
NodeName={host} NodeAddr=127.0.0.1 CPUs={cpus} State=UNKNOWN
PartitionName=all Nodes={host} Default=YES MaxTime=INFINITE State=UP
AuthType=auth/munge
AuthInfo=socket={folder}/munge.socket
CredType=cred/munge
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
SlurmUser=root
SlurmdUser=root
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd.pid
SlurmctldLogFile={folder}/slurmctld.log
SlurmdLogFile={folder}/slurmd.log
ReturnToService=2
JobRequeue=1
KillWait=60
MpiDefault=none
"""
PROGRAMS = ("munged", "slurmctld", "slurmd", "sbatch", "srun", "scontrol")
SECONDS = 30


@contextmanager
def cluster() -> Iterator[Path]:
    """One that runs while the block does, and its folder; SLURM's programs find it by the environment."""
    missing = [program for program in PROGRAMS if shutil.which(program) is None]
    if missing or os.geteuid() != 0:
        raise SystemExit(f"this needs root and apt-get install slurm-wlm munge; missing: {missing}")
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        os.environ["SLURM_CONF"] = _configure(folder)
        daemons: list[subprocess.Popen[bytes]] = []
        try:
            daemons.append(_munged(folder))
            _until((folder / "munge.socket").exists, "munged")
            for command in (["slurmctld", "-D", "-c"], ["slurmd", "-D"]):
                daemons.append(
                    subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
                )
            _until(lambda: "idle" in output("sinfo", "-h", "-o", "%t"), "slurmctld and slurmd")
            yield folder
        finally:
            for daemon in reversed(daemons):
                daemon.terminate()
                daemon.wait()


def output(*command: str) -> str:
    """What one of SLURM's programs prints."""
    return subprocess.run(command, capture_output=True, text=True, check=False).stdout


def _configure(folder: Path) -> str:
    for name in ("state", "spool"):
        (folder / name).mkdir()
    folder.chmod(0o755)
    host = socket.gethostname().partition(".")[0]
    path = folder / "slurm.conf"
    path.write_text(CONFIGURATION.format(host=host, cpus=os.cpu_count(), folder=folder))
    return str(path)


def _munged(folder: Path) -> "subprocess.Popen[bytes]":
    key = folder / "munge.key"
    key.write_bytes(os.urandom(128))
    key.chmod(0o400)
    places = {"socket": "munge.socket", "pid-file": "munged.pid", "log-file": "munged.log",
              "seed-file": "munged.seed", "key-file": "munge.key"}  # fmt: skip
    options = [f"--{option}={folder / name}" for option, name in places.items()]
    return subprocess.Popen(["munged", "--foreground", "--force", *options], stderr=subprocess.DEVNULL)


def _until(there: Callable[[], bool], what: str) -> None:
    for _ in range(SECONDS * 5):
        if there():
            return
        time.sleep(0.2)
    raise SystemExit(f"{what} did not come up")
