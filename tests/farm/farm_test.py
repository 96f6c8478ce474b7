#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""scenes/farm on a real Slurm of two nodes, on this machine: tasks that are killed, a node that fails, preemption, a warning of the
time limit, a full disk. Every picture has the bits of a single run in the end, and none is finished twice.
usage: farm_test.py MARRAM

Exit code 77: Slurm could not start here; what needs none is tested all the same."""
import os
import random
import re
import signal
import subprocess
import sys
import tempfile
import time

sys.dont_write_bytecode = True
from slurm import CannotStart, Slurm, kill, name_of, state_of, stop

marram = os.path.abspath(sys.argv[1])
farm = os.path.join(os.path.dirname(os.path.abspath(__file__)), "../../scenes/farm")
os.environ["MARRAM"] = marram
failures = 0

SCENE = """fps = 24
frames = [1, 40]
camera = { position = [0, 1.1, 4], target = [0, 0.35, 0] }
film = { size = [64, 36], samples = 100 }
wind = { speed = 6, global_rotate = 1, gusts = { num_gusts = 40, radius_range = [1, 2] } }
light = [{ name = "sun", type = "sun", direction = [-1, 1, 1] }]
material = [{ name = "blade", type = "grass" }]
mesh = [{ name = "ground", type = "plane", size = [4, 3] }]
[[procedural]]
name = "grass"
type = "groom"
on = "ground"
material = "blade"
count = 500
length = [0.2, 0.5]
width = 0.008
"""


DUNES = """frames = [1, 6]
camera = { position = [0, 20, 60], target = [0, 0, 0] }
film = { size = [64, 36], samples = 4 }
wind = { speed = 9 }
light = [{ name = "sun", type = "sun", direction = [-1, 1, 1] }]
material = [{ name = "loose", type = "diffuse" }]
[[procedural]]
name = "desert"
type = "terrain"
material = "loose"
size = [63, 31]
cell = 1
layer = [{ type = "mass_desert", kind = "dome", height = [1, 2], spacing = [20, 30] }, { type = "dune_solver", days_per_frame = 2 }]
"""


def check(name, good, more=""):
    global failures
    failures += not good
    print(f"{'ok' if good else 'FAILED'}: {name}{': ' + str(more) if more != '' and not good else ''}", flush=True)


def run_farm(*arguments, environment=None):
    return subprocess.run([farm, *arguments], capture_output=True, text=True, env=environment)


def bits(pictures):
    """A digest of the pixels and channels of each, without the metadata, some of which is time."""
    done = subprocess.run(["oiiotool", "--no-autopremult", "--info", "--hash", "-v", *pictures], capture_output=True, text=True)
    hashes = re.findall(r"SHA-1: (\w+)", done.stdout)
    return hashes if len(hashes) == len(pictures) else done.stderr


def names(folder, frames):
    return [f"{folder}/a.{frame:04}.exr" for frame in frames]


def logs(folder):
    """The lines of all tasks of the last submit, but names of states that a task has saved when it was stopped."""
    lines = []
    for file in os.listdir(f"{folder}/a.farm"):
        if file.startswith(("parts.", "merge.")) and file.endswith(".log"):
            done = os.path.exists(f"{folder}/a.farm/{file[:-4]}.done")
            with open(f"{folder}/a.farm/{file}") as handle:
                lines += [line for line in handle.read().splitlines() if done or not line.endswith(".state.tif")]
    return lines


def sheet(folder):
    with open(f"{folder}/a.farm/sheet.0.log") as file:
        return file.read()


class Submits:
    """Submits of one output, until all is there. Counts how often each picture was finished."""

    def __init__(self, slurm, folder, pictures, *arguments, parts=()):
        self.slurm, self.folder, self.pictures, self.arguments = slurm, folder, pictures, arguments
        self.finished = dict.fromkeys([*pictures, *parts], 0)
        self.stamps = {}

    def begin(self):
        done = run_farm("lawn.toml", "-o", f"{self.folder}/a.####.exr", *self.arguments, environment=self.slurm.environment)
        check(f"{self.folder}: is submitted", done.returncode == 0, done.stderr)

    def end(self):
        """Waits; the number of pictures that the last job reports."""
        self.slurm.wait_until_idle()
        for line in logs(self.folder):
            if line in self.finished:
                self.finished[line] += 1
        again = [picture for picture, stamp in self.stamps.items() if os.stat(picture).st_mtime_ns != stamp]
        check(f"{self.folder}: pictures of an earlier submit stay", not again, again)
        self.stamps = {picture: os.stat(picture).st_mtime_ns for picture in self.pictures if os.path.exists(picture)}
        return int(sheet(self.folder).split(" of ")[0].splitlines()[-1])

    def check_all(self, reference):
        check(f"{self.folder}: all {len(self.pictures)} pictures have the bits of a single run", bits(self.pictures) == reference)
        twice = {file: count for file, count in self.finished.items() if count > 1}
        check(f"{self.folder}: nothing is finished twice", not twice, twice)


def running(slurm, node=None):
    """The tasks that run the program: its process by the job's id."""
    found = {}
    for pid in slurm.processes(**({"SLURMD_NODENAME": node} if node else {})):
        if name_of(pid) == "marram":
            try:
                with open(f"/proc/{pid}/environ", "rb") as file:
                    job = re.search(rb"\0SLURM_JOB_ID=(\d+)", b"\0" + file.read())
            except OSError:
                continue
            if job:
                found[job[1].decode()] = pid
    return found


def wait_for(what, ready, seconds=600):
    end = time.monotonic() + seconds
    while not (value := ready()):
        if time.monotonic() > end:
            raise RuntimeError(f"{what}: not within {seconds} s")
        time.sleep(0.02)
    return value


def hold_task(slurm, chance, node=None):
    """Stops some task that runs, at some moment of it: its job and process. So it is there still when something happens to it,
    however slow this machine is; KILL ends it, CONT lets it go on."""
    while True:
        wait_for("a task runs", lambda: running(slurm, node))
        time.sleep(chance.uniform(0, 0.4))
        found = list(running(slurm, node).items())
        if found and held((task := chance.choice(found))[1]):
            return task


def held(pid):
    try:
        os.kill(pid, signal.SIGSTOP)
    except ProcessLookupError:
        return False
    wait_for("it stops or ends", lambda: state_of(pid) in ("T", "Z", ""))
    return state_of(pid) == "T"


def job_field(slurm, job, field):
    return re.search(rf"\b{field}=(\S*)", slurm.run("scontrol", "--oneliner", "show", "job", job))[1]


def gone(pid):
    return lambda: name_of(pid) != "marram"


def cancel(slurm, job, pid):
    """Kills the whole task by Slurm: it is not requeued."""
    slurm.run("scancel", "--signal=KILL", "--full", job)
    wait_for("it ends", gone(pid))


def preempt(slurm, job, pid):
    """Sends an urgent job to the node of a task."""
    slurm.run("sbatch", "--partition=urgent", f"--nodelist={job_field(slurm, job, 'NodeList')}", "--output=/dev/null", "--wrap=sleep 0.2")
    wait_for("the task is requeued", lambda: int(job_field(slurm, job, "Restarts")))
    wait_for("it ends", gone(pid))


def bring_back(slurm):
    """node2, after it was down or drained."""
    slurm.start_node("node2")

    def is_back():
        # Refused where slurmctld has taken the node back by itself when slurmd told that it is there.
        slurm.run("scontrol", "update", "nodename=node2", "state=resume", check=False)
        time.sleep(0.1)
        return slurm.states()["node2"] in ("idle", "mixed", "allocated")
    wait_for("node2 is there again", is_back)


def mishaps(slurm, chance):
    """Whatever may happen to tasks, each at some moment of one."""
    job, pid = hold_task(slurm, chance)
    kill(pid)
    wait_for("it ends", gone(pid))
    print(f"    the program of job {job} is killed by kill -9")

    job, pid = hold_task(slurm, chance)
    cancel(slurm, job, pid)
    print(f"    job {job} is killed by scancel")

    job, pid = hold_task(slurm, chance)
    preempt(slurm, job, pid)
    print(f"    job {job} is preempted")

    job, pid = hold_task(slurm, chance, "node2")
    slurm.kill_node("node2")
    slurm.run("scontrol", "update", "nodename=node2", "state=down", "reason=test")
    print(f"    node2 fails with job {job}")
    wait_for("its task is given back", lambda: job_field(slurm, job, "JobState") != "RUNNING")
    bring_back(slurm)


def array(slurm, chance, reference):
    """40 frames by chunks of 5."""
    work = Submits(slurm, "array", names("array", range(1, 41)), "--chunk", "5")
    work.begin()
    again = run_farm("lawn.toml", "-o", "array/a.####.exr", environment=slurm.environment)
    check("a second submit is refused while the first is queued", again.returncode == 2 and "is in the queue" in again.stderr, again.stderr)
    mishaps(slurm, chance)
    print(f"    after the first submit {work.end()} of 40 are there")
    work.begin()
    check("the second submit leaves none missing", work.end() == 40, sheet("array"))
    work.check_all(reference)
    check("the contact sheet is there", os.path.exists("array/a.sheet.png"))
    for picture in chance.sample(work.pictures, 3):
        told = subprocess.run([marram, "compare", picture, picture.replace("array", "one")], capture_output=True, text=True)
        check(f"marram compare: {picture}", told.returncode == 0 and "every number is the same" in told.stdout, told.stdout)


def ranges(slurm, chance):
    """One frame over 8 ranges of samples, merged."""
    one("whole", 7, "--spp", "1600")
    picture = "ranges/a.0007.exr"
    parts = [f"{picture}.samples_{first}_{first + 199}.state.tif" for first in range(0, 1600, 200)]
    work = Submits(slurm, "ranges", [picture], "--frames=7", "--spp=1600", "--samples-per-task=200", parts=parts)
    work.begin()
    job, pid = hold_task(slurm, chance)
    kill(pid)
    wait_for("it ends", gone(pid))
    cancel(slurm, *hold_task(slurm, chance))
    check("without a range there is no picture", work.end() == 0 and "missing: 7" in sheet("ranges"), sheet("ranges"))
    work.begin()
    check("the second submit merges it", work.end() == 1, sheet("ranges"))
    check("states of parts that are merged are gone", not any(map(os.path.exists, parts)))
    work.begin()
    work.end()
    work.check_all(bits(names("whole", [7])))


def warning(slurm, chance):
    """The signal that Slurm sends before the time limit; sent here, since limits are whole minutes. The task saves what it has, goes
    back into the queue by itself, and goes on."""
    one("long", 7, "--spp", "2000")
    work = Submits(slurm, "warned", names("warned", [7]), "--frames", "7", "--spp", "2000", "--checkpoint", "0.2")
    work.begin()
    wait_for("some samples are traced", lambda: os.path.exists("warned/a.0007.exr.state.tif"))
    job, pid = hold_task(slurm, chance)
    slurm.run("scancel", "--batch", "--signal=USR1", job)
    os.kill(pid, signal.SIGCONT)
    wait_for("it ends", gone(pid))
    check("the picture is there after one submit", work.end() == 1, sheet("warned"))
    work.check_all(bits(names("long", [7])))
    lines = logs("warned")
    check("the task was warned", any("after a warning of the time limit" in line for line in lines), lines)
    check("it went on where it stopped", any("resumed at" in line for line in lines), lines)


# A full disk of the pictures, in a mount namespace of one node; the folder of logs is not on it.
FULL_DISK = """set -e
mount --bind full/a.farm keep
mount -t tmpfs -o size=64k tmpfs full
mkdir full/a.farm
mount --bind keep full/a.farm
dd if=/dev/zero of=full/filler bs=4k 2>/dev/null || true
exec "$@"
"""


def full_disk(slurm, reference):
    for folder in ("full/a.farm", "keep"):
        os.makedirs(folder)
    stop(slurm.daemons["node2"])
    space = ["unshare", "--mount"] if os.getuid() == 0 else ["unshare", "--mount", "--map-current-user", "--keep-caps"]
    if subprocess.run([*space, "bash", "-c", FULL_DISK, "bash", "true"], capture_output=True).returncode:
        print("SKIPPED: a full disk: this machine allows no mount namespaces")
        slurm.start_node("node2")
        return
    slurm.start_node("node2", around=[*space, "bash", "-c", FULL_DISK, "bash"], cwd=os.getcwd())
    wait_for("node2 is there again", lambda: slurm.states()["node2"] == "idle")
    work = Submits(slurm, "full", names("full", range(1, 9)), "--frames", "1-8", "--chunk", "1")
    work.begin()
    wait_for("a task fails", lambda: any("No space left on device" in line for line in logs("full")))
    slurm.run("scontrol", "update", "nodename=node2", "state=drain", "reason=disk")
    there = work.end()
    check("what the node with the full disk had is missing", there < 8 and "missing: " in sheet("full"), sheet("full"))
    stop(slurm.daemons["node2"])
    bring_back(slurm)
    work.begin()
    check("after its repair none is missing", work.end() == 8, sheet("full"))
    work.check_all(reference[:8])


def one(folder, frames, *options):
    """The reference: a single run."""
    os.makedirs(folder, exist_ok=True)
    subprocess.run([marram, "render", "lawn.toml", "-o", f"{folder}/a.####.exr", f"--frames={frames}", *options, "--quiet"], check=True,
                   stdout=subprocess.DEVNULL)


def simulated():
    """Dunes: the first task leaves the states at which the others begin."""
    subprocess.run([marram, "render", "dunes.toml", "-o", "one/d.####.exr", "--state", "own"], check=True, capture_output=True)
    done = run_farm("dunes.toml", "-o", "dunes/d.####.exr", "--chunk=2", "--local=2")
    frames = [f"d.{frame:04}.exr" for frame in range(1, 7)]
    check("dunes: states first, the bits of a single run", done.returncode == 0 and done.stdout.startswith("states 1 of 1: done\nparts ") and
          bits([f"dunes/{name}" for name in frames]) == bits([f"one/{name}" for name in frames]), done.stdout + done.stderr)
    states = {file: os.path.getmtime(os.path.join(folder, file)) for folder, _, files in os.walk("dunes.states") for file in files}
    first = os.path.getmtime("dunes/d.farm/states.0.done")
    check("dunes: states of the frames at which tasks begin", {file for file, made in states.items() if made <= first} == {"3.state", "5.state"},
          states)
    dry = run_farm("dunes.toml", "--chunk=2", "--dry-run", "--memory=3G")
    check("dunes: tasks wait for the states", "--dependency=afterok:JOBSTATES --array=0-2" in dry.stdout, dry.stdout)
    runs = [line for line in dry.stdout.splitlines() if line.startswith('run "$marram" render')]
    check("--memory is that of the states and of the tasks", len(runs) == 2 and all("--memory 3G" in line for line in runs), dry.stdout)


def without_slurm(reference):
    """The same plan here; mistakes; --dry-run."""
    here = run_farm("lawn.toml", "-o", "here/a.####.exr", "--frames=1-6", "--chunk=2", "--local=2")
    check("--local renders all", here.returncode == 0 and "6 of 6 frames are there" in here.stdout, here.stdout + here.stderr)
    check("--local: the bits of a single run", bits(names("here", range(1, 7))) == reference[:6])
    os.remove("here/a.0004.exr")
    stamp = os.stat("here/a.0003.exr").st_mtime_ns
    here = run_farm("lawn.toml", "-o", "here/a.####.exr", "--frames=1-6", "--chunk=2", "--local=2")
    check("--local again renders what is missing", here.returncode == 0 and bits(names("here", range(1, 7))) == reference[:6] and
          os.stat("here/a.0003.exr").st_mtime_ns == stamp, here.stdout + here.stderr)
    check("--local again has one task", here.stdout.startswith("5 of 6 frames are there: 1 task\nparts 1 of 1: done\n"), here.stdout)
    os.remove("here/a.sheet.png")
    here = run_farm("lawn.toml", "-o", "here/a.####.exr", "--frames=1-6", "--local=2")
    check("nothing to render: the contact sheet is made", here.returncode == 0 and os.path.exists("here/a.sheet.png") and
          here.stdout == "6 of 6 frames are there: no tasks\nhere/a.sheet.png\n6 of 6 frames are there\n", here.stdout + here.stderr)
    in_ranges = ("lawn.toml", "-o", "split/a.####.exr", "--frames=2,3", "--samples-per-task=40")
    os.mkdir("split")
    subprocess.run([marram, "render", "lawn.toml", "-o", "split/a.0003.exr", "--frame=3", "--samples=40-79"], check=True, capture_output=True)
    here = run_farm(*in_ranges, "--local=2")
    check("ranges: those that are there have no task", here.returncode == 0 and bits(names("split", (2, 3))) == reference[1:3] and
          here.stdout.startswith("0 of 2 frames are there: 5 tasks\n") and not any(".state." in name for name in os.listdir("split")),
          here.stdout + here.stderr)
    os.remove("split/a.0002.exr")
    here = run_farm(*in_ranges, "--dry-run")
    check("ranges: those of a frame that is there have no task", here.stdout.startswith("# 1 of 2 frames are there: 3 tasks\n") and
          "firsts=(0 3)" in here.stdout, here.stdout + here.stderr)
    os.mkdir("none")
    os.mkdir("none/a.0002.exr") # cannot be written
    here = run_farm("lawn.toml", "-o", "none/a.####.exr", "--frames=1-3", "--chunk=1", "--spp=1", "--local=2")
    check("--local says what is missing", here.returncode == 1 and "missing: 2:" in here.stdout, here.stdout + here.stderr)
    dry = run_farm("lawn.toml", "-o", "dry/a.####.exr", "--frames=-4--1,1-9x2", "--chunk=3", "--dry-run", "--set", "wind.speed=3")
    check("--dry-run prints the scripts and writes nothing", dry.returncode == 0 and "#SBATCH --requeue" in dry.stdout and
          "tasks=(--frames=-4--2 --frames=-1,1,3 --frames=5,7,9)" in dry.stdout and "sbatch --parsable --array=0-2 dry/a.farm/parts.sh 0" in dry.stdout and
          "--set wind.speed=3" in dry.stdout and not os.path.exists("dry"), dry.stdout)
    for arguments, told in ((["nothing.toml"], "nothing.toml: "), (["lawn.toml", "--chunk=0"], "--chunk"), (["lawn.toml", "--frames=9-1"], "backwards"),
                            (["lawn.toml", "--frames=1,b"], "'b'"), (["lawn.toml", "-o", "a.exr"], "####"), (["lawn.toml", "--local=many"], "--local"),
                            (["lawn.toml", "--set=wind.sped=3"], "wind.sped"), (["lawn.toml", "--frame=3"], "--frames"),
                            (["lawn.toml", "--chunk=2", "--samples-per-task=9"], "leave out one"), ([], "SCENE")):
        done = run_farm(*arguments, "--dry-run")
        check(f"{' '.join(arguments)}: one line, exit code 2", done.returncode == 2 and told in done.stderr and done.stderr.count("\n") == 1 and
              done.stdout == "", done.stderr)
    done = run_farm("lawn.toml", environment=dict(os.environ, PATH=os.path.dirname(sys.executable), MARRAM=marram))
    if not os.path.exists(os.path.join(os.path.dirname(sys.executable), "sbatch")):
        check("without Slurm: --local is proposed", done.returncode == 2 and "--local" in done.stderr, done.stderr)


def main():
    chance = random.Random(1)
    clock = time.monotonic()

    def lap(what):
        nonlocal clock
        print(f"{what}: {time.monotonic() - clock:.0f} s")
        clock = time.monotonic()

    one("one", "1-40")
    reference = bits(names("one", range(1, 41)))
    lap("single runs")
    without_slurm(reference)
    simulated()
    lap("without Slurm")
    try:
        with Slurm() as slurm:
            array(slurm, chance, reference)
            lap("an array")
            ranges(slurm, chance)
            lap("ranges of samples")
            warning(slurm, chance)
            lap("a warning")
            full_disk(slurm, reference)
            lap("a full disk")
    except CannotStart as problem:
        print(f"SKIPPED: {problem}")
        return 77 if not failures else 1
    return failures > 0


with tempfile.TemporaryDirectory(prefix="marram_farm_") as folder:
    os.chdir(folder)
    with open("lawn.toml", "w") as file:
        file.write(SCENE)
    with open("dunes.toml", "w") as file:
        file.write(DUNES)
    code = main()
    os.chdir("/")
sys.exit(code)
