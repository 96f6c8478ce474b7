# SPDX-License-Identifier: Apache-2.0
"""A private Slurm on this machine, for tests: its own munge, a slurmctld, two slurmd with one CPU each. No systemd, no root, no file
outside a temporary folder, no port but free ones of the loopback.

    with Slurm() as slurm:
        slurm.run("sbatch", ...)

Raises CannotStart where it cannot run; stops whatever happens, with all of its jobs.
"""

import ctypes
import os
import pwd
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time

CONF = """ClusterName=marram
SlurmctldHost=localhost
SlurmctldPort={ports[0]}
SlurmUser={user}
SlurmdUser={user}
AuthType=auth/munge
CredType=cred/munge
# A requeued job waits for the end of its credential, at least 5 s.
AuthInfo=socket={folder}/munge.sock,cred_expire=5
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool.%n
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/%n.pid
SlurmctldLogFile={folder}/slurmctld.log
SlurmdLogFile={folder}/%n.log
# No cgroups: they need root, and may not be there.
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/none
MpiDefault=none
SwitchType=switch/none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
AccountingStorageType=accounting_storage/none
JobCompType=jobcomp/filetxt
JobCompLoc={folder}/jobs.txt
# Jobs of a partition of higher priority put those of the lower back into the queue.
PreemptType=preempt/partition_prio
PreemptMode=REQUEUE
JobRequeue=1
SchedulerType=sched/backfill
# A farm of seconds: as quick as Slurm allows.
SchedulerParameters=sched_interval=1,bf_interval=1,batch_sched_delay=1,sched_min_interval=10000,requeue_delay=1
MinJobAge=600
KillWait=2
SlurmdTimeout=10
ReturnToService=2
MailProg=/bin/true
NodeName=node1 NodeHostname=localhost NodeAddr=127.0.0.1 Port={ports[1]} CPUs=1
NodeName=node2 NodeHostname=localhost NodeAddr=127.0.0.1 Port={ports[2]} CPUs=1
PartitionName=farm Nodes=node[1-2] Default=YES MaxTime=60 PriorityTier=1 State=UP
PartitionName=urgent Nodes=node[1-2] MaxTime=60 PriorityTier=9 State=UP
"""
NODES = ("node1", "node2")


PR_SET_PDEATHSIG = 1


class CannotStart(Exception):
    pass


def free_ports(count):
    sockets = [socket.socket() for _ in range(count)]
    for one in sockets:
        one.bind(("127.0.0.1", 0))
    ports = [one.getsockname()[1] for one in sockets]
    for one in sockets:
        one.close()
    return ports


class Slurm:
    def __enter__(self):
        missing = [name for name in ("munged", "slurmctld", "slurmd", "sbatch") if not self.program(name)]
        if missing:
            raise CannotStart(f"{', '.join(missing)} not installed: apt-get install slurmctld slurmd slurm-client munge")
        self.folder = tempfile.mkdtemp(prefix="marram_slurm_")
        self.daemons = {}
        signal.signal(signal.SIGTERM, lambda *_: sys.exit(128 + signal.SIGTERM))
        self.environment = dict(os.environ, SLURM_CONF=f"{self.folder}/slurm.conf")
        try:
            self.start()
        except BaseException:
            self.__exit__()
            raise
        return self

    @staticmethod
    def program(name):
        return shutil.which(name, path=os.environ.get("PATH", "") + ":/usr/sbin:/sbin")

    def start(self):
        os.chmod(self.folder, 0o755)  # munged wants its folders safe and its socket reachable
        for name in ("state", *(f"spool.{node}" for node in NODES)):
            os.mkdir(f"{self.folder}/{name}")
        with open(f"{self.folder}/slurm.conf", "w") as file:
            file.write(CONF.format(folder=self.folder, user=pwd.getpwuid(os.getuid()).pw_name, ports=free_ports(3)))
        with open(f"{self.folder}/key", "wb") as file:
            os.fchmod(file.fileno(), 0o400)
            file.write(os.urandom(1024))
        self.spawn("munged", "--foreground", f"--key-file={self.folder}/key", f"--socket={self.folder}/munge.sock",
                   f"--pid-file={self.folder}/munge.pid", f"--log-file={self.folder}/munge.log",
                   f"--seed-file={self.folder}/munge.seed")
        self.wait_for(lambda: os.path.exists(f"{self.folder}/munge.sock"), "munged")
        self.spawn("slurmctld", "-D", "-c")
        self.wait_for(lambda: subprocess.run(["scontrol", "ping"], env=self.environment, capture_output=True).returncode == 0,
                      "slurmctld")
        for node in NODES:
            self.start_node(node)
        self.wait_for(lambda: all(state == "idle" for state in self.states().values()), "slurmd")

    def start_node(self, node, around=(), cwd=None):
        """around: a command that runs the daemon, in a namespace for example."""
        self.spawn(*around, self.program("slurmd"), "-D", "-N", node, name=node, cwd=cwd)

    def spawn(self, program, *arguments, name=None, cwd=None):
        with open(f"{self.folder}/{name or program}.out", "ab") as log:
            self.daemons[name or program] = subprocess.Popen([self.program(program), *arguments], env=self.environment, stdout=log,
                                                             stderr=log, stdin=subprocess.DEVNULL, start_new_session=True, cwd=cwd, preexec_fn=end_with_parent)

    def wait_for(self, ready, what, seconds=120):
        end = time.monotonic() + seconds
        while not ready():
            dead = [name for name, process in self.daemons.items() if process.poll() is not None]
            if dead or time.monotonic() > end:
                raise CannotStart(f"{dead[0] if dead else what} could not start: {self.last_words(dead[0] if dead else what)}")
            time.sleep(0.05)

    def last_words(self, name):
        lines = []
        for file in os.listdir(self.folder):
            if file.endswith((".out", ".log")) and (name in file or name == "slurmd"):
                lines += [line for line in open(f"{self.folder}/{file}", errors="replace") if "rror" in line or "fatal" in line]
        return " | ".join(line.strip() for line in lines[-3:]) or "no reason in its log"

    def states(self):
        """idle, mixed, allocated, down, ... by node"""
        text = self.run("sinfo", "--noheader", "--Node", "--partition=farm", "--format=%N %T")
        return dict(line.split() for line in text.splitlines())

    def run(self, *command, check=True):
        """Its output. Raises RuntimeError with its errors."""
        done = subprocess.run(command, env=self.environment, capture_output=True, text=True, cwd=self.folder)
        if check and done.returncode:
            raise RuntimeError(f"{' '.join(command)}: exit code {done.returncode}: {done.stderr.strip() or done.stdout.strip()}")
        return done.stdout

    def processes(self, **variables):
        """Ids of the processes that this Slurm has started, whose environment has these variables."""
        wanted = {f"{name}={value}".encode() for name, value in dict(variables, SLURM_CONF=self.environment["SLURM_CONF"]).items()}
        found = []
        for pid in filter(str.isdigit, os.listdir("/proc")):
            try:
                with open(f"/proc/{pid}/environ", "rb") as file:
                    if wanted <= set(file.read().split(b"\0")):
                        found.append(int(pid))
            except OSError:
                pass # it has ended, or is another user's
        return found

    def kill_node(self, node):
        """As if its power failed: the daemon and all that it has started, at once."""
        self.daemons[node].kill()
        self.daemons[node].wait()
        # slurmstepd has the environment of slurmd, which does not name the node; its tasks do. Again, for what they have started
        # meanwhile.
        while tasks := [pid for pid in self.processes(SLURMD_NODENAME=node) if state_of(pid) not in ("Z", "")]:
            for pid in [*map(parent_of, tasks), *tasks]:
                if pid in tasks or name_of(pid) == "slurmstepd":
                    kill(pid)

    def wait_until_idle(self, seconds=600):
        """Until no job is in the queue."""
        end = time.monotonic() + seconds
        while self.run("squeue", "--noheader"):
            if time.monotonic() > end:
                raise RuntimeError("jobs do not end:\n" + self.run("squeue"))
            time.sleep(0.1)

    def __exit__(self, *_):
        for name in reversed(self.daemons):
            stop(self.daemons[name])
        for pid in self.processes(): # tasks that outlive slurmd
            if pid != os.getpid():
                kill(pid)
        shutil.rmtree(self.folder, ignore_errors=True)


def end_with_parent():
    """If even the test is killed, its daemons end."""
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGTERM)


def stop(process):
    if process.poll() is None:
        process.terminate()
        try:
            process.wait(10)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def kill(pid):
    try:
        os.kill(pid, signal.SIGKILL)
    except ProcessLookupError:
        pass


def stat_of(pid):
    """The fields of /proc/PID/stat behind the name: state, parent, ...; none if it has ended."""
    try:
        with open(f"/proc/{pid}/stat") as file:
            return file.read().rsplit(")", 1)[1].split()
    except OSError:
        return []


def state_of(pid):
    """R, S, T (stopped), Z, ...; "" if it has ended"""
    return "".join(stat_of(pid)[:1])


def parent_of(pid):
    return int((stat_of(pid) or [0, 0])[1])


def name_of(pid):
    try:
        with open(f"/proc/{pid}/comm") as file:
            return file.read().strip()
    except OSError:
        return ""
