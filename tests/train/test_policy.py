"""The policy that MaskablePPO trains is the network that the agent runs."""

from __future__ import annotations

import numpy as np
import pytest

from tests.observation_samples import PIXEL, observations

torch = pytest.importorskip("torch", reason="training needs torch (pip install 'robotpack[train]')")
pytest.importorskip("sb3_contrib", reason="training needs sb3-contrib (pip install 'robotpack[train]')")

from gymnasium import spaces  # noqa: E402

from packenv.agents.placement_network import NetworkConfig, best_actions  # noqa: E402
from packenv.agents.policy_files import current_layout  # noqa: E402
from packenv.train.policy import PlacementPolicy  # noqa: E402

SMALL = NetworkConfig(channels=4, embedding=16, context=24, patch=4)


@pytest.fixture
def policy():
    """A fresh policy for the hand-made observations."""
    torch.manual_seed(0)
    boxes = {
        name: spaces.MultiBinary(array.shape[1])
        if name == "action_mask"
        else spaces.Box(-10, 100, array.shape[1:], np.float32)
        for name, array in observations(1).items()
    }
    return PlacementPolicy(
        spaces.Dict(boxes),
        spaces.Discrete(13),
        lambda remaining: 1e-3,
        layout=current_layout(PIXEL),
        network=SMALL,
    )


def tensors(obs):
    return {name: torch.as_tensor(array, dtype=torch.float32) for name, array in obs.items()}


def test_logits_and_value_are_the_networks(policy):
    obs = observations(5)
    with torch.no_grad():
        logits, value = policy.placement_network()(tensors(obs))
        distribution = policy.get_distribution(tensors(obs)).distribution
        torch.testing.assert_close(distribution.probs, torch.softmax(logits, 1))
        torch.testing.assert_close(policy.predict_values(tensors(obs)), value)


def test_the_agent_takes_what_the_policy_predicts(policy):
    obs = observations(30)
    predicted, _ = policy.predict(obs, deterministic=True, action_masks=obs["action_mask"])
    np.testing.assert_array_equal(predicted, best_actions(policy.placement_network(), obs))


def test_what_is_masked_has_no_probability_and_gets_no_gradient(policy):
    obs = observations(5)
    valid = obs["action_mask"].astype(bool)
    with torch.no_grad():
        probs = policy.get_distribution(tensors(obs), action_masks=valid).distribution.probs.numpy()
    assert (probs[~valid] == 0).all()
    assert (probs[valid] > 0).all()


def test_every_weight_learns(policy):
    """No layer is cut off: after one step on all losses every parameter has moved."""
    before = {name: p.detach().clone() for name, p in policy.placement_network().named_parameters()}
    obs = observations(16)
    for _ in range(3):  # the heads begin near 0, so what lies behind them moves from the second step on
        actions = torch.as_tensor([np.flatnonzero(mask)[0] for mask in obs["action_mask"]])
        values, log_prob, entropy = policy.evaluate_actions(
            tensors(obs), actions, tensors(obs)["action_mask"]
        )
        loss = (values - 3).square().mean() - log_prob.mean() + 0.1 * entropy.mean()
        policy.optimizer.zero_grad()
        loss.backward()
        policy.optimizer.step()
    after = dict(policy.placement_network().named_parameters())
    assert [name for name in before if torch.equal(before[name], after[name])] == []
    assert sum(p.numel() for p in after.values()) == sum(p.numel() for p in policy.parameters())
