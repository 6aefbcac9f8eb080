"""Training from the command line to an agent, in the environment itself."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="training needs torch (pip install 'robotpack[train]')")
pytest.importorskip("sb3_contrib", reason="training needs sb3-contrib (pip install 'robotpack[train]')")

from sb3_contrib import MaskablePPO  # noqa: E402

from packenv.agents import make  # noqa: E402
from packenv.agents.policy_files import read_policy  # noqa: E402
from packenv.env.pack_env import PackEnv  # noqa: E402
from packenv.train.__main__ import main  # noqa: E402
from packenv.train.config import TrainConfig  # noqa: E402
from packenv.train.environments import training_environments  # noqa: E402
from packenv.train.learning import new_model, run  # noqa: E402
from packenv.train.runs import RunFolder  # noqa: E402

ENV = {
    "mask": "legal",
    "containers": [[0.08, 0.07, 0.05]],
    "candidates": 6,
    "max_items": 4,
    "grid": {"cell_size": 0.005, "grid_step": 0.02, "n_poses": 2, "n_yaws": 1},
    "map_step": 2,
}
ORDERS = {"kind": "random", "items": [2, 4], "longest_side": [0.01, 0.05]}
SMALL = {
    "timesteps": 96,
    "checkpoint_every": 32,
    "evaluation_episodes": 2,
    "env_config": ENV,
    "order_generator": ORDERS,
    "ppo": {"rollout": 32, "batch_size": 16, "n_epochs": 2},
    "network": {"channels": 2, "embedding": 8, "context": 12, "patch": 3},
}


class StoppedError(Exception):
    """Stands for a kill at a moment that a test chooses."""


def train(folder: Path, stop_at: int | None = None, **changes: object) -> list[dict[str, object]]:
    """Train; with ``stop_at``, until the first row with as many steps."""

    def report(row):
        if stop_at is not None and row.get("timesteps") == stop_at:
            raise StoppedError

    return run(RunFolder(folder), TrainConfig.from_mapping({**SMALL, **changes}), report)


@pytest.fixture(scope="module")
def whole_run(tmp_path_factory):
    """The folder of a run that was never stopped."""
    folder = tmp_path_factory.mktemp("whole") / "run"
    train(folder)
    return folder


def without_time(rows):
    return [{name: value for name, value in row.items() if name != "wall_s"} for row in rows]


def same_weights(one: Path, other: Path) -> bool:
    pairs = zip(read_policy(one).parameters(), read_policy(other).parameters(), strict=True)
    return all(torch.equal(a, b) for a, b in pairs)


def test_a_run_leaves_all_that_it_promises(whole_run):
    rows = RunFolder(whole_run).rows()
    assert [row["timesteps"] for row in rows] == [0, 32, 64, 96]
    assert set(RunFolder(whole_run).baselines()) == {"random", "hm"}
    assert (whole_run / "curve.svg").read_text().count("<svg") == 1
    events = b"".join(path.read_bytes() for path in (whole_run / "tensorboard").iterdir())
    for tag in (b"held_out/return", b"train/entropy_loss", b"rollout/ep_rew_mean"):
        assert tag in events
    document = json.loads((whole_run / "config.json").read_text())
    assert document["train"]["seed"] == 0
    assert TrainConfig.from_mapping(document["train"]) == TrainConfig.from_mapping(SMALL)
    assert not list(whole_run.glob(".*"))


def test_a_run_that_stopped_goes_on_as_if_it_never_had(whole_run, tmp_path):
    with pytest.raises(StoppedError):
        train(tmp_path, stop_at=32)
    assert not same_weights(whole_run, tmp_path)
    train(tmp_path)
    assert without_time(RunFolder(tmp_path).rows()) == without_time(RunFolder(whole_run).rows())
    assert same_weights(whole_run, tmp_path)


def test_another_seed_is_another_run_on_the_same_held_out_episodes(whole_run, tmp_path):
    train(tmp_path, seed=1, timesteps=32)
    assert not same_weights(whole_run, tmp_path)
    assert RunFolder(tmp_path).baselines() == RunFolder(whole_run).baselines()


def test_a_finished_run_can_be_made_longer(whole_run, tmp_path):
    train(tmp_path, timesteps=32)
    rows = train(tmp_path, timesteps=64)
    assert [row["timesteps"] for row in rows] == [0, 32, 64]
    assert train(tmp_path, timesteps=64) == rows


def test_the_learned_agent_packs(whole_run):
    agent, env = make("learned", weights=whole_run), PackEnv(ENV, order_generator=ORDERS)
    obs, info = env.reset(seed=5)
    done = False
    while not done:
        obs, _, terminated, truncated, info = env.step(agent.act(obs, info))
        assert not info["invalid_action"]
        done = terminated or truncated
    assert not truncated
    env.close()


def test_a_trusted_zip_acts_as_the_model_that_was_saved(tmp_path):
    envs = training_environments(TrainConfig.from_mapping(SMALL))
    model = new_model(TrainConfig.from_mapping(SMALL), envs)
    model.save(tmp_path / "model.zip")
    agent = make("learned", weights=tmp_path / "model.zip", trust=True)
    obs = envs.reset()
    for _ in range(5):
        masks = obs["action_mask"]
        expected, _ = model.predict(obs, deterministic=True, action_masks=masks)
        np.testing.assert_array_equal(agent.act_batch(obs, {}), expected)
        obs, *_ = envs.step(expected)
    again = MaskablePPO.load(tmp_path / "model.zip")
    for a, b in zip(model.policy.parameters(), again.policy.parameters(), strict=True):
        assert torch.equal(a, b)
    envs.close()


def test_a_folder_with_a_run_is_not_overwritten(whole_run, capsys):
    before = (whole_run / "config.json").read_bytes()
    assert main(["--out", str(whole_run), "--timesteps", "10"]) == 2
    assert "holds a run, go on with --resume" in capsys.readouterr().err
    assert main(["--out", str(whole_run), "--resume", "--seed", "9"]) == 2
    assert "begun with another configuration" in capsys.readouterr().err
    assert (whole_run / "config.json").read_bytes() == before


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--env-config", "{"], "--env-config: is not JSON"),
        (["--env-config", '{"masks": "legal"}'], "masks"),
        (["--order-generator", "nowhere.json"], "nowhere.json"),
        (["--config", '{"timestep": 1}'], "did you mean 'timesteps'"),
        (["--reward", '{"beauty": 1}'], "beauty"),
        (["--timesteps", "0"], "timesteps is 0"),
    ],
)
def test_bad_input_is_one_line_and_leaves_nothing(tmp_path, capsys, options, message):
    assert main(["--out", str(tmp_path / "run"), *options]) == 2
    said = capsys.readouterr().err
    assert message in said
    assert said.count("\n") == 1
    assert not (tmp_path / "run").exists()


def test_a_package_that_is_not_installed_is_one_line(tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "sb3_contrib", None)
    monkeypatch.delitem(sys.modules, "packenv.train.learning")
    assert main(["--out", str(tmp_path / "run")]) == 2
    assert "training needs the package sb3_contrib: pip install" in capsys.readouterr().err


def _start(folder: Path, *options: str) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", "packenv.train", "--out", str(folder), *options]
    root = Path(__file__).resolve().parents[2]
    return subprocess.Popen(command, cwd=root, stdout=subprocess.DEVNULL, start_new_session=True)


@pytest.mark.slow
@pytest.mark.parametrize("workers", [1, 2])
def test_kill_9_costs_nothing_but_time(tmp_path, workers):
    """Killed at three arbitrary moments, a run ends with the rows and weights of one that was not."""
    config = {**SMALL, "timesteps": 320, "workers": workers}
    (tmp_path / "config.json").write_text(json.dumps(config))
    options = ("--config", str(tmp_path / "config.json"))
    whole, killed = tmp_path / "whole", tmp_path / "killed"
    assert _start(whole, *options).wait(300) == 0
    seen: list[dict[str, object]] = []
    for delay in (0.0, 0.3, 0.7):
        process = _start(killed, *options, "--resume")
        wanted, deadline = len(seen) + 1, time.monotonic() + 120
        while len(_lines(killed)) < wanted and process.poll() is None and time.monotonic() < deadline:
            time.sleep(0.02)
        time.sleep(delay)
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
        now = RunFolder(killed).rows()
        assert now[: len(seen)] == seen
        seen = now
    assert _start(killed, *options, "--resume").wait(300) == 0
    assert RunFolder(killed).rows()[: len(seen)] == seen
    assert without_time(RunFolder(killed).rows()) == without_time(RunFolder(whole).rows())
    assert same_weights(whole, killed)


@pytest.mark.slow
def test_a_worker_that_dies_is_one_line(tmp_path, monkeypatch, capsys):
    made = []

    def remembered(config):
        made.append(training_environments(config))
        return made[0]

    def kill_one(row):
        if "timesteps" in row:
            made[0].venv.processes[1].kill()

    monkeypatch.setattr("packenv.train.learning.training_environments", remembered)
    monkeypatch.setattr("packenv.train.__main__._report", kill_one)
    config = json.dumps({**SMALL, "timesteps": 10_000, "workers": 2})
    assert main(["--out", str(tmp_path / "run"), "--config", config]) == 1
    assert "an environment's process died" in capsys.readouterr().err
    assert len(RunFolder(tmp_path / "run").rows()) == 1


def _lines(folder: Path) -> list[bytes]:
    path = folder / "progress.jsonl"
    return path.read_bytes().splitlines() if path.exists() else []
