"""The folder of a run: whatever moment a kill comes at, nothing that was finished is lost."""

from __future__ import annotations

import random
from pathlib import Path

import numpy as np
import pytest

from packenv.errors import InputError

torch = pytest.importorskip("torch", reason="training needs torch (pip install 'robotpack[train]')")

from packenv.agents.placement_network import NetworkConfig, PlacementNetwork  # noqa: E402
from packenv.agents.policy_files import current_layout, read_policy  # noqa: E402
from packenv.train.config import TrainConfig  # noqa: E402
from packenv.train.runs import Checkpoint, RandomStates, RunFolder  # noqa: E402

SMALL = NetworkConfig(channels=4, embedding=16, context=24, patch=4)


def network(seed=0):
    torch.manual_seed(seed)
    return PlacementNetwork(current_layout(0.01), SMALL)


def checkpoint(timesteps, made):
    optimizer = torch.optim.Adam(made.parameters())
    made.actor.defer[0].weight.sum().backward()
    optimizer.step()
    row = {"key": f"at {timesteps}", "timesteps": timesteps, "return": 1.0}
    return Checkpoint(
        timesteps, 7, 2.5, made.state_dict(), optimizer.state_dict(), RandomStates.of_now(), row
    )


@pytest.fixture
def folder(tmp_path):
    begun = RunFolder(tmp_path / "deep" / "run")
    assert not begun.begun
    begun.begin(TrainConfig(network=SMALL, seed=4), current_layout(0.01))
    return begun


def test_a_run_that_has_begun_has_its_configuration_and_no_checkpoint(folder):
    assert folder.begun
    assert folder.config() == TrainConfig(network=SMALL, seed=4)
    assert folder.load() is None
    assert folder.rows() == []


def test_a_checkpoint_comes_back_as_it_was(folder):
    made = network()
    saved = checkpoint(64, made)
    folder.save(saved, made)
    back = folder.load()
    assert (back.timesteps, back.updates, back.wall_s, back.row) == (64, 7, 2.5, saved.row)
    other = network(seed=1)
    folder.restore(back, other)
    assert all(torch.equal(a, b) for a, b in zip(made.parameters(), other.parameters(), strict=True))
    again = torch.optim.Adam(other.parameters())
    again.load_state_dict(back.optimizer)
    assert len(again.state_dict()["state"]) == len(saved.optimizer["state"]) > 0
    assert folder.rows() == [saved.row]
    assert all(
        torch.equal(a, b)
        for a, b in zip(made.parameters(), read_policy(folder.path).parameters(), strict=True)
    )


def test_generators_go_on_where_they_were():
    def draw():
        return torch.rand(3).tolist(), np.random.random(3).tolist(), random.random()  # noqa: NPY002

    state = RandomStates.of_now()
    first = draw()
    draw()
    state.restore()
    assert draw() == first


@pytest.mark.parametrize("moment", ["before the weights", "before the row"])
def test_a_kill_between_checkpoint_and_row_loses_no_row(folder, monkeypatch, moment):
    made = network()
    folder.save(checkpoint(64, made), made)

    def killed(*arguments):
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        target = (
            "packenv.train.runs.write_weights"
            if moment == "before the weights"
            else "packenv.io.rows.RowFile.append"
        )
        patched.setattr(target, killed)
        with pytest.raises(KeyboardInterrupt):
            folder.save(checkpoint(128, made), made)
    assert [row["timesteps"] for row in folder.rows()] == [64]
    back = folder.load()
    assert back.timesteps == 128
    folder.restore(back, network(seed=2))
    assert [row["timesteps"] for row in folder.rows()] == [64, 128]
    folder.restore(back, network(seed=2))
    assert [row["timesteps"] for row in folder.rows()] == [64, 128]


def test_a_kill_while_the_checkpoint_is_written_leaves_the_last_one(folder, monkeypatch):
    made = network()
    folder.save(checkpoint(64, made), made)

    def killed(*arguments):
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(Path, "replace", killed)
        with pytest.raises(KeyboardInterrupt):
            folder.save(checkpoint(128, made), made)
    assert folder.load().timesteps == 64
    assert [path.name for path in folder.path.iterdir() if path.suffix == ".tmp"] == []


def test_a_torn_row_is_cut_and_finished_rows_stay(folder):
    made = network()
    for steps in (64, 128):
        folder.save(checkpoint(steps, made), made)
    with (folder.path / "progress.jsonl").open("ab") as stream:
        stream.write(b'{"key": "at 19')
    assert [row["timesteps"] for row in folder.rows()] == [64, 128]
    folder.save(checkpoint(192, made), made)
    assert [row["timesteps"] for row in folder.rows()] == [64, 128, 192]


@pytest.mark.parametrize("content", [b"", b"nonsense", b"PK\x03\x04 torn"])
def test_a_damaged_checkpoint_is_one_line(folder, content):
    (folder.path / "checkpoint.pt").write_bytes(content)
    with pytest.raises(InputError, match="is not a checkpoint of this version") as caught:
        folder.load()
    assert "\n" not in str(caught.value)


def test_a_checkpoint_that_would_run_code_is_refused(folder):
    class Harmful:
        def __reduce__(self):
            return (Path.touch, (folder.path / "ran",))

    torch.save({"timesteps": Harmful()}, folder.path / "checkpoint.pt")
    with pytest.raises(InputError, match="is not a checkpoint"):
        folder.load()
    assert not (folder.path / "ran").exists()


def test_a_checkpoint_of_another_network_is_refused(folder):
    made = network()
    folder.save(checkpoint(64, made), made)
    other = PlacementNetwork(
        current_layout(0.01), NetworkConfig(channels=4, embedding=8, context=24, patch=4)
    )
    with pytest.raises(InputError, match="does not fit"):
        folder.restore(folder.load(), other)


def test_a_folder_that_cannot_be_one_is_refused(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot be made a folder"):
        RunFolder(tmp_path / "file").begin(TrainConfig(), current_layout(0.01))
