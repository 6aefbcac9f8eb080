"""Where pybullet is not installed MuJoCo is the engine; where neither is, physics ends in one line before any work."""

from __future__ import annotations

import json
import platform
import subprocess
import sys
from pathlib import Path

import pytest

from packenv.errors import InputError, PhysicsError
from tests.conftest import REPO

NO_BULLET = "import sys; sys.modules['pybullet'] = None\n"
NO_ENGINE = NO_BULLET + "sys.modules['mujoco'] = None\n"
NEEDS = "engine mujoco needs the package mujoco, which "


def python(code: str, blocked: str = NO_ENGINE) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-c", blocked + code], capture_output=True, text=True, cwd=REPO)


def robotpack(
    *arguments: str | Path, module: str = "packenv.cli", blocked: str = NO_ENGINE
) -> subprocess.CompletedProcess[str]:
    words = [str(argument) for argument in arguments]
    return python(f"from {module} import main\nsys.exit(main({words!r}))", blocked)


@pytest.fixture(scope="module")
def plan(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Made without any engine."""
    folder = tmp_path_factory.mktemp("plan")
    order = folder / "order.csv"
    order.write_text("item,qty\nmug,1\n")
    outputs = [f"--{kind}={folder / f'plan.{kind}'}" for kind in ("html", "png")]
    done = robotpack("pack", order, "--container", "0.2x0.2x0.2", "--out", folder / "plan.json", *outputs)
    assert done.returncode == 0, done.stderr
    return folder / "plan.json"


def test_pack_verify_and_view_need_no_physics(plan, tmp_path):
    assert {path.suffix for path in plan.parent.iterdir()} == {".csv", ".json", ".html", ".png"}
    assert robotpack("verify", plan).returncode == 0
    for name in ("plan.html", "plan.gif"):
        assert robotpack("view", plan, "-o", tmp_path / name).returncode == 0
        assert (tmp_path / name).stat().st_size > 1000
    assert robotpack("export", plan, "-o", tmp_path / "trajectories.json").returncode == 0


def test_mujoco_carries_a_plan_out_where_pybullet_is_missing(plan):
    done = robotpack("execute", plan, "--json", blocked=NO_BULLET)
    assert done.returncode == 0, done.stderr
    document = json.loads(done.stdout)
    assert document["success"]
    assert document["config"]["world"]["engine"]["name"] == "mujoco"
    missing = robotpack("execute", plan, "--engine", "bullet", blocked=NO_BULLET)
    assert (missing.returncode, missing.stdout) == (2, "")
    assert missing.stderr.startswith("robotpack: engine bullet needs the package pybullet, which ")
    assert missing.stderr.count("\n") == 1


@pytest.mark.parametrize(
    "arguments",
    [("execute",), ("pack", "--rehearse", "3"), ("pack", "--stability", "physics")],
    ids=" ".join,
)
def test_physics_ends_in_one_line_before_any_work(plan, tmp_path, arguments):
    # The catalogue does not exist: nothing has been opened when physics is found missing.
    document = plan if arguments[0] == "execute" else plan.with_name("order.csv")
    done = robotpack(arguments[0], document, *arguments[1:], "--catalogue", tmp_path / "none")
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith(f"robotpack: {NEEDS}")
    assert done.stderr.count("\n") == 1


@pytest.mark.parametrize(
    ("module", "more"),
    [("packenv.agents.__main__", ("--agent", "hm")), ("packenv.train.__main__", ("--out", "no-such-run"))],
)
def test_a_run_of_episodes_in_physics_ends_in_one_line(module, more):
    pytest.importorskip("torch") if "train" in module else None
    done = robotpack(*more, "--env-config", '{"physics": true}', "--workers", "2", module=module)
    assert (done.returncode, done.stdout) == (2, "")
    assert NEEDS in done.stderr
    assert done.stderr.count("\n") == 1
    assert not (REPO / "no-such-run").exists()


def test_the_environment_needs_it_for_physics_alone():
    done = python("""
import gymnasium as gym, packenv
from packenv.errors import PhysicsError
env = gym.make("RobotPack-v0", config={"mask": "legal"}, render_mode="rgb_array")
observation, info = env.reset(seed=0)
env.step(0)
print(*env.render().shape)
try:
    gym.make("RobotPack-v0", config={"physics": True})
except PhysicsError as problem:
    print(problem)
""")
    assert done.returncode == 0, done.stderr
    size, line = done.stdout.splitlines()
    assert size == "480 480 3"
    assert line.startswith(NEEDS)


@pytest.mark.parametrize(
    ("version", "system", "machine", "words"),
    [
        ((3, 11), "linux", "x86_64", "is not installed: pip install pybullet"),
        ((3, 12), "linux", "x86_64", "not for Python 3.12 on linux x86_64: give --engine mujoco"),
        ((3, 11), "darwin", "arm64", "not for Python 3.11 on darwin arm64"),
        ((3, 10), "linux", "aarch64", "not for Python 3.10 on linux aarch64"),
    ],
)
def test_the_line_says_why_and_what_would_help(monkeypatch, version, system, machine, words):
    from packenv.sim import engines

    monkeypatch.setattr(sys, "version_info", version)
    monkeypatch.setattr(sys, "platform", system)
    monkeypatch.setattr(platform, "machine", lambda: machine)
    line = engines._missing("bullet", ModuleNotFoundError("No module named 'pybullet'", name="pybullet"))
    assert line.startswith("engine bullet needs the package pybullet, which ")
    assert words in line
    broken = engines._missing("bullet", ImportError("libX.so: cannot open shared object file", name="libX"))
    assert "cannot be loaded: libX.so" in broken
    assert issubclass(PhysicsError, InputError)
