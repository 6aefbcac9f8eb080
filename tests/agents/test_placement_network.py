"""Laws of the placement network, on observations made by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from packenv.env.observation import FEATURES
from packenv.errors import InputError
from tests.observation_samples import PIXEL, observations

torch = pytest.importorskip(
    "torch", reason="the placement policy needs torch (pip install 'robotpack[train]')"
)

from packenv.agents.placement_network import (  # noqa: E402
    NetworkConfig,
    PlacementNetwork,
    best_actions,
)
from packenv.agents.policy_files import current_layout  # noqa: E402

SMALL = NetworkConfig(channels=4, embedding=16, context=24, patch=4)


def network(seed: int = 0, layout=None):
    torch.manual_seed(seed)
    made = PlacementNetwork(layout or current_layout(PIXEL), SMALL).double()
    with torch.no_grad():  # heads begin near 0, where nearly everything is equal: make them tell
        for parameter in made.actor.parameters():
            parameter.add_(0.3 * torch.randn_like(parameter))
    return made.eval()


def run(made, obs):
    with torch.no_grad():
        logits, value = made({name: torch.as_tensor(a, dtype=torch.float64) for name, a in obs.items()})
    return logits.numpy(), value.numpy()


def test_permuting_candidates_permutes_their_logits_and_nothing_else():
    made, obs = network(), observations(3)
    order = np.random.default_rng(1).permutation(12)
    mixed = {**obs, "candidates": obs["candidates"][:, order]}
    mixed["action_mask"] = np.concatenate(
        (obs["action_mask"][:, :-1][:, order], obs["action_mask"][:, -1:]), 1
    )
    logits, value = run(made, obs)
    mixed_logits, mixed_value = run(made, mixed)
    np.testing.assert_allclose(mixed_logits[:, :-1], logits[:, :-1][:, order], atol=1e-12)
    np.testing.assert_allclose(mixed_logits[:, -1], logits[:, -1], atol=1e-12)
    np.testing.assert_allclose(mixed_value, value, atol=1e-12)
    assert np.ptp(logits[:, :-1]) > 0.01


def test_padding_changes_nothing():
    made, obs = network(), observations(3)
    padded = {**obs, "candidates": np.pad(obs["candidates"], ((0, 0), (0, 5), (0, 0)))}
    mask = obs["action_mask"]
    padded["action_mask"] = np.concatenate((mask[:, :-1], np.zeros((3, 5), np.int8), mask[:, -1:]), 1)
    padded["remaining"] = np.pad(obs["remaining"], ((0, 0), (0, 3), (0, 0)))
    padded["item"] = np.pad(obs["item"], ((0, 0), (0, 2), (0, 0), (0, 0), (0, 0)))
    logits, value = run(made, obs)
    more, more_value = run(made, padded)
    np.testing.assert_allclose(more[:, [*range(12), -1]], logits, atol=1e-12)
    np.testing.assert_allclose(more_value, value, atol=1e-12)


def test_observations_of_a_batch_do_not_see_each_other():
    made, obs = network(), observations(4)
    logits, value = run(made, obs)
    for k in range(4):
        alone = run(made, {name: array[k : k + 1] for name, array in obs.items()})
        np.testing.assert_allclose(alone[0][0], logits[k], atol=1e-12)
        np.testing.assert_allclose(alone[1][0], value[k], atol=1e-12)


@pytest.mark.parametrize("part", ["container", "item", "candidates", "remaining", "state"])
def test_every_part_of_the_observation_matters(part):
    made, obs, other = network(), observations(2), observations(2, seed=5)
    changed = {**obs, part: other[part] * (1.1 if part == "state" else 1)}
    assert np.abs(run(made, changed)[0] - run(made, obs)[0]).max() > 1e-6
    assert np.abs(run(made, changed)[1] - run(made, obs)[1]).max() > 1e-6


def test_one_network_serves_other_sizes():
    made = network()
    for sizes in ({"candidates": 3}, {"side": 33}, {"items": 1}, {"poses": 2}):
        logits, value = run(made, observations(2, **sizes))
        assert np.isfinite(logits).all()
        assert np.isfinite(value).all()


def test_a_candidate_sees_the_surface_below_it():
    """A tower raises the logit's input of the candidate above it and of no candidate far away."""
    made, obs = network(), observations(1)
    obs["candidates"][:] = 0
    obs["container"][:] = 0
    at = {name: FEATURES.index(name) for name in FEATURES}
    for k, x in enumerate((0.02, 0.12)):
        row = obs["candidates"][0, k]
        row[at["present"]], row[at["x"]], row[at["y"]] = 1, x, 0.05
        row[[at[side] for side in ("length", "width", "height")]] = 0.04
    obs["action_mask"][:] = 1
    tower = {**obs, "container": obs["container"].copy()}
    tower["container"][0, 4, 7] = 0.1  # the square from (0.04, 0.07) to (0.05, 0.08)

    def rows(observation):
        with torch.no_grad():
            return made.encoder({k: torch.as_tensor(a, dtype=torch.float64) for k, a in observation.items()})

    change = (rows(tower).candidates - rows(obs).candidates).abs().amax(2)[0]
    assert change[0] > 1e-6
    assert change[1] == 0


def test_the_best_action_is_a_valid_one():
    made, obs = network().float(), observations(40)
    chosen = best_actions(made, obs)
    assert (obs["action_mask"][np.arange(40), chosen] == 1).all()
    obs["action_mask"][:] = 0
    obs["action_mask"][:, 5] = 1
    assert (best_actions(made, obs) == 5).all()


def test_an_untrained_policy_has_no_opinion():
    torch.manual_seed(0)
    logits, _ = PlacementNetwork(current_layout(PIXEL), NetworkConfig())(
        {name: torch.as_tensor(a, dtype=torch.float32) for name, a in observations(8).items()}
    )
    assert logits.detach().abs().max() < 0.2


def test_a_layout_without_a_needed_column_is_refused():
    layout = current_layout(PIXEL)
    with pytest.raises(InputError, match="candidates lacks the columns yaw"):
        PlacementNetwork(replace(layout, candidates=tuple(n for n in FEATURES if n != "yaw")), SMALL)


@pytest.mark.parametrize("name", ["channels", "embedding", "context", "patch"])
def test_sizes_out_of_range_are_refused(name):
    with pytest.raises(InputError, match=f"network {name} is 0"):
        NetworkConfig(**{name: 0})
