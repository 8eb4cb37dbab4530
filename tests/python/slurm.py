"""A Slurm of one node on the loopback device, without accounting: Debian's slurmctld, slurmd and munge."""

import getpass
import os
import shutil
import socket
import subprocess
import time
from pathlib import Path

#: Debian keeps daemons where the PATH of a user does not look.
PATH = f"{os.environ['PATH']}:/usr/sbin:/sbin"
DAEMONS = ("munged", "slurmctld", "slurmd")
COMMANDS = ("sbatch", "srun", "squeue", "scancel", "scontrol", "sinfo")

CONFIGURATION = """
ClusterName=loopback
SlurmctldHost={host}(127.0.0.1)
SlurmctldPort={ports[0]}
SlurmdPort={ports[1]}
SlurmUser={user}
SlurmdUser={user}
AuthType=auth/munge
AuthInfo=socket={folder}/munge.socket
CredType=cred/munge
CommunicationParameters=NoInAddrAny,NoCtldInAddrAny
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd.pid
SlurmctldLogFile={folder}/slurmctld.log
SlurmdLogFile={folder}/slurmd.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/none
AccountingStorageType=accounting_storage/none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
MpiDefault=none
ReturnToService=2
MinJobAge=3600
KillWait=2
NodeName={host} NodeAddr=127.0.0.1 CPUs={cpus} RealMemory={memory_mb} State=UNKNOWN
PartitionName=all Nodes=ALL Default=YES MaxTime=INFINITE State=UP
"""


class Impossible(Exception):
    """This machine cannot run a Slurm; says why."""


def free_ports(count):
    sockets = [socket.socket() for _ in range(count)]
    for bound in sockets:
        bound.bind(("127.0.0.1", 0))
    ports = [bound.getsockname()[1] for bound in sockets]
    for bound in sockets:
        bound.close()
    return ports


class Slurm:
    """Started by `with`, ended with it; `environment` lets commands find it."""

    def __init__(self, folder, cpus=2):
        missing = [name for name in (*DAEMONS, *COMMANDS) if not shutil.which(name, path=PATH)]
        if missing:
            raise Impossible(f"no {', '.join(missing)}; Debian has them in slurmctld, slurmd, slurm-client and munge")
        self.folder = Path(folder)
        self.cpus = min(cpus, os.cpu_count())
        self.daemons = []
        self.environment = {**os.environ, "PATH": f"{self.folder / 'bin'}:{PATH}"}

    def __enter__(self):
        try:
            self.start()
        except (Impossible, OSError, subprocess.SubprocessError) as cause:
            self.stop()
            raise Impossible(f"Slurm did not start: {cause}\n{self.logs()}") from cause
        return self

    def __exit__(self, *_):
        self.stop()

    def start(self):
        self.folder.mkdir(mode=0o755, exist_ok=True)
        for name in ("state", "spool"):
            (self.folder / name).mkdir()
        key = self.folder / "munge.key"
        key.write_bytes(os.urandom(128))
        key.chmod(0o400)
        host = socket.gethostname().split(".")[0]
        memory_mb = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") // (1 << 20) * 9 // 10
        text = CONFIGURATION.format(
            host=host,
            ports=free_ports(2),
            user=getpass.getuser(),
            folder=self.folder,
            cpus=self.cpus,
            memory_mb=memory_mb,
        )
        (self.folder / "slurm.conf").write_text(text)
        self.wrap()
        names = {"key-file": "munge.key", "socket": "munge.socket", "pid-file": "munge.pid", "log-file": "munge.log"}
        names["seed-file"] = "munge.seed"
        options = [f"--{option}={self.folder / name}" for option, name in names.items()]
        # Forced, since folders of temporary files are everybody's to write to.
        self.daemon("munged", "--foreground", "--force", *options)
        self.wait("munge", lambda: (self.folder / "munge.socket").exists())
        self.daemon("slurmctld", "-D")
        self.daemon("slurmd", "-D", "-N", host)
        self.wait("node", lambda: self.ask("sinfo", "-h", "-o", "%t", check=False).strip() == "idle")

    def wrap(self):
        """Commands that know where this Slurm is, as those of a cluster do, whatever environment they are given."""
        bin_ = self.folder / "bin"
        bin_.mkdir()
        for name in (*DAEMONS[1:], *COMMANDS):
            path = shutil.which(name, path=PATH)
            (bin_ / name).write_text(f'#!/bin/sh\nSLURM_CONF={self.folder}/slurm.conf exec {path} "$@"\n')
            (bin_ / name).chmod(0o755)

    def daemon(self, *command):
        path = shutil.which(command[0], path=self.environment["PATH"])
        with open(self.folder / f"{command[0]}.out", "wb") as log:
            self.daemons.append(
                subprocess.Popen(
                    [path, *command[1:]], env=self.environment, stdout=log, stderr=log, start_new_session=True
                )
            )

    def wait(self, what, ready, seconds=60):
        until = time.monotonic() + seconds
        while not ready():
            ended = [Path(daemon.args[0]).name for daemon in self.daemons if daemon.poll() is not None]
            if ended or time.monotonic() > until:
                raise Impossible(f"no {what} after {seconds} s, or {ended} ended")
            time.sleep(0.2)

    def ask(self, *command, check=True):
        path = shutil.which(command[0], path=self.environment["PATH"])
        done = subprocess.run([path, *command[1:]], env=self.environment, capture_output=True, text=True, check=check)
        return done.stdout

    def running(self):
        """(job, its comment) of all jobs that run; the comment tells the rule and what it is of."""
        lines = self.ask("squeue", "-h", "-t", "running", "-o", "%i %k").splitlines()
        return [tuple(line.split(" ", 1)) for line in lines]

    def waiting_or_running(self):
        return self.ask("squeue", "-h", "-t", "pending,running,completing,configuring", "-o", "%i", check=False).split()

    def stop(self):
        if len(self.daemons) > 1:
            for options in (["--signal=KILL", "--full"], []):
                self.ask("scancel", *options, "--user", getpass.getuser(), check=False)
            until = time.monotonic() + 20
            while self.waiting_or_running() and time.monotonic() < until:
                time.sleep(0.5)
        for daemon in reversed(self.daemons):
            daemon.terminate()
            try:
                daemon.wait(10)
            except subprocess.TimeoutExpired:
                daemon.kill()
                daemon.wait()

    def logs(self):
        files = [*self.folder.glob("*.log"), *self.folder.glob("*.out")]
        return "\n".join(f"== {file.name}\n{file.read_text(errors='replace')[-1500:]}" for file in files)
