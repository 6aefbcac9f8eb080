"""Episodes: the same seed gives the same record, whoever runs it, and a stopped run goes on."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from packenv.agents.__main__ import main
from packenv.agents.running import (
    AgentSpec,
    EpisodeRecord,
    FailedEpisode,
    Setting,
    episode_jobs,
    run_episodes,
)
from packenv.config import GridConfig
from packenv.env.config import PackConfig
from packenv.errors import InputError

CONFIG = PackConfig(
    mask="legal",
    containers=((0.24, 0.24, 0.1),),
    grid=GridConfig(cell_size=0.005, grid_step=0.02, n_poses=2, n_yaws=2),
    candidates=8,
)
ORDERS = {"kind": "list", "items": ["sugar_box", "cracker_box", "wood_block", "pudding_box", "milk_carton"]}
SETTING = Setting(CONFIG, ORDERS)
AGENTS = [AgentSpec("hm"), AgentSpec("random"), AgentSpec("planner", {"heuristic": "mta"})]


def records(workers: int = 1, seed: int = 0, episodes: int = 3) -> list[EpisodeRecord]:
    jobs = episode_jobs(AGENTS, SETTING, episodes=episodes, seed=seed)
    found = [record for _, record in run_episodes(jobs, SETTING, workers=workers)]
    assert all(isinstance(record, EpisodeRecord) for record in found)
    return sorted(found, key=lambda record: (record.agent, record.episode))


def test_the_number_of_workers_changes_no_record() -> None:
    alone = records(1)
    assert len(alone) == 9
    assert records(2) == alone == records(1)


def test_another_seed_draws_other_numbers_and_more_episodes_change_none() -> None:
    few, many, other = records(episodes=2), records(episodes=3), records(seed=1)
    assert [r for r in many if r.episode < 2] == few
    assert {r.seed for r in many}.isdisjoint(r.seed for r in other)
    assert [r.total_reward for r in many if r.agent == "random"] != [
        r.total_reward for r in other if r.agent == "random"
    ]


def test_a_record_adds_up() -> None:
    for record in records():
        assert record.items == len(ORDERS["items"])
        assert record.packed + len(record.left_over) == record.items
        assert record.complete == (not record.left_over)
        assert 0 < record.utilization < 1
        # The default reward: the share packed, the utilization, and 1 for a complete order.
        expected = record.packed / record.items + record.utilization + record.complete
        assert record.total_reward == pytest.approx(expected, abs=1e-6)
        assert record.steps >= record.packed > 0
        assert record.invalid_actions == 0
        assert not record.truncated
        assert record.seconds > 0


def keys(setting: Setting, agents: list[AgentSpec], seed: int = 0) -> set[str]:
    return {job.key for job in episode_jobs(agents, setting, episodes=2, seed=seed)}


def test_whatever_a_record_depends_on_is_in_its_key(tmp_path: Path) -> None:
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "policy.safetensors").write_bytes(name.encode())
    settings = [
        SETTING,
        Setting(CONFIG),
        Setting(replace(CONFIG, mask="robot"), ORDERS),
        Setting(CONFIG, {**ORDERS, "items": ["sugar_box"]}),
    ]
    specs = [AgentSpec("hm"), AgentSpec("planner"), AgentSpec("planner", {"max_checked": 3})]
    specs += [AgentSpec("learned", {"weights": tmp_path / name, "trust": False}) for name in ("a", "b")]
    found = [keys(s, [spec], seed) for s in settings for spec in specs for seed in (0, 1)]
    assert len(set().union(*found)) == sum(map(len, found)) == 2 * len(settings) * len(specs) * 2
    assert keys(SETTING, specs) == keys(Setting(PackConfig.from_mapping(CONFIG.to_mapping()), ORDERS), specs)


def test_weights_trained_anew_in_the_same_folder_are_another_agent(tmp_path: Path) -> None:
    weights = tmp_path / "policy.safetensors"
    spec = [AgentSpec("learned", {"weights": tmp_path})]
    weights.write_bytes(b"1")
    before = keys(SETTING, spec)
    weights.write_bytes(b"2")
    assert keys(SETTING, spec).isdisjoint(before)
    weights.write_bytes(b"1")
    assert keys(SETTING, spec) == before


@pytest.mark.parametrize("workers", [1, 2])
@pytest.mark.parametrize(
    ("setting", "agent"),
    [
        (Setting(replace(CONFIG, catalogue="no-such-folder")), AgentSpec("hm")),
        (Setting(CONFIG, {"kind": "nonsense"}), AgentSpec("hm")),
        (SETTING, AgentSpec("planner", {"max_checked": 0})),
    ],
)
def test_bad_input_is_said_before_any_episode(setting: Setting, agent: AgentSpec, workers: int) -> None:
    jobs = episode_jobs([agent], setting, episodes=2, seed=0)
    with pytest.raises(InputError):
        list(run_episodes(jobs, setting, workers=workers))


ARGUMENTS = [
    *("--agent", "hm,random", "--env-config", json.dumps(CONFIG.to_mapping())),
    *("--order-generator", json.dumps(ORDERS)),
]


def printed(capsys: pytest.CaptureFixture[str], *arguments: str) -> dict[str, Any]:
    assert main([*ARGUMENTS, *arguments, "--json"]) == 0
    document: dict[str, Any] = json.loads(capsys.readouterr().out)
    for line in document["agents"]:
        line.pop("steps_per_s")
    return document


def test_a_stopped_run_goes_on_and_tells_the_same(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "rows.jsonl"
    whole = printed(capsys, "--episodes", "3")
    assert whole == printed(capsys, "--episodes", "3", "--out", str(out))
    rows = out.read_bytes().splitlines(keepends=True)
    assert len(rows) == 6
    # Killed in the middle of the fourth row.
    out.write_bytes(b"".join(rows[:3]) + rows[3][:20])
    assert whole == printed(capsys, "--episodes", "3", "--out", str(out))
    again = out.read_bytes().splitlines(keepends=True)
    assert again[:3] == rows[:3]
    assert [json.loads(row)["key"] for row in again] == [json.loads(row)["key"] for row in rows]
    # All there: nothing is run.
    assert whole == printed(capsys, "--episodes", "3", "--out", str(out))
    assert out.read_bytes() == b"".join(again)


def test_the_table_has_a_line_an_agent(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([*ARGUMENTS, "--episodes", "2"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == ["agent", "hm", "random"]


def test_an_episode_that_fails_costs_itself_alone(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    from packenv.agents import running

    real = running.run_episode

    def failing(env: Any, agent: Any, *, name: str, episode: int, seed: int) -> EpisodeRecord:
        if name == "hm" and episode == 1:
            raise RuntimeError("the roof\nfell in")
        return real(env, agent, name=name, episode=episode, seed=seed)

    out = tmp_path / "rows.jsonl"
    monkeypatch.setattr(running, "run_episode", failing)
    assert main([*ARGUMENTS, "--episodes", "2", "--out", str(out), "--json"]) == 1
    said = capsys.readouterr()
    document = json.loads(said.out)
    assert {line["agent"]: line["episodes"] for line in document["agents"]} == {"hm": 1, "random": 2}
    (failure,) = [FailedEpisode(**failure) for failure in document["failed"]]
    assert (failure.agent, failure.episode) == ("hm", 1)
    assert "episode 1 of hm" in said.err
    assert "RuntimeError: the roof fell in" in said.err
    # The next run makes up for it.
    monkeypatch.undo()
    assert len(out.read_bytes().splitlines()) == 3
    assert printed(capsys, "--episodes", "2", "--out", str(out))["failed"] == []
    assert len(out.read_bytes().splitlines()) == 4
