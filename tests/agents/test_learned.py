"""The learned agent: files in, actions out."""

from __future__ import annotations

import json
import subprocess
import sys

import numpy as np
import pytest

from packenv.agents import make
from packenv.errors import InputError
from tests.env_samples import make_env
from tests.observation_samples import PIXEL, observations

torch = pytest.importorskip("torch", reason="the learned agent needs torch (pip install 'robotpack[train]')")

from packenv.agents.learned import LearnedAgent  # noqa: E402
from packenv.agents.placement_network import NetworkConfig, PlacementNetwork  # noqa: E402
from packenv.agents.policy_files import current_layout, read_policy, write_config, write_weights  # noqa: E402

SMALL = NetworkConfig(channels=4, embedding=16, context=24, patch=4)


@pytest.fixture
def policy(tmp_path):
    """A folder with a policy, and its network."""
    torch.manual_seed(3)
    network = PlacementNetwork(current_layout(PIXEL), SMALL)
    write_config(tmp_path, SMALL, current_layout(PIXEL), {"seed": 3})
    write_weights(tmp_path, network)
    return tmp_path, network


def test_what_is_read_is_what_was_written(policy):
    folder, network = policy
    again = read_policy(folder)
    assert all(torch.equal(a, b) for a, b in zip(network.parameters(), again.parameters(), strict=True))


def test_it_takes_the_valid_action_with_the_largest_logit(policy):
    folder, network = policy
    obs = observations(16)
    with torch.no_grad():
        logits = network({k: torch.as_tensor(a, dtype=torch.float32) for k, a in obs.items()})[0].numpy()
    agent = make("learned", weights=folder)
    agent.reset(0)
    chosen = agent.act_batch(obs, {})
    assert chosen.dtype == np.int64
    for k in range(16):
        valid = np.flatnonzero(obs["action_mask"][k])
        assert chosen[k] == valid[logits[k, valid].argmax()]
        assert agent.act({name: array[k] for name, array in obs.items()}, {}) == chosen[k]


def test_torch_is_loaded_with_the_first_policy_and_stable_baselines_never(policy):
    folder, _ = policy
    program = (
        "import sys; from packenv.agents import make; import packenv.agents.learned; "
        "assert 'torch' not in sys.modules; "
        f"make('learned', weights={str(folder)!r}); assert 'torch' in sys.modules; "
        "assert not {'stable_baselines3', 'sb3_contrib', 'packenv.train'} & set(sys.modules)"
    )
    subprocess.run([sys.executable, "-c", program], check=True)


def _damage(folder, kind):
    config, weights = folder / "config.json", folder / "policy.safetensors"
    document = json.loads(config.read_text())
    if kind == "no config":
        config.unlink()
    elif kind == "no weights":
        weights.unlink()
    elif kind == "config is no JSON":
        config.write_text("{")
    elif kind == "torn weights":
        weights.write_bytes(weights.read_bytes()[:-8])
    elif kind == "another version":
        config.write_text(json.dumps({**document, "schema_version": 99}))
    elif kind == "no layout":
        config.write_text(json.dumps({key: document[key] for key in ("schema_version", "network")}))
    elif kind == "other columns":
        document["layout"]["remaining"].reverse()
        config.write_text(json.dumps(document))
    elif kind == "other sizes":
        document["network"]["embedding"] += 1
        config.write_text(json.dumps(document))
    else:
        network = read_policy(folder)
        with torch.no_grad():
            next(network.parameters()).fill_(float("nan"))
        write_weights(folder, network)


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        ("no config", "config.json: cannot be read"),
        ("no weights", "policy.safetensors: cannot be read"),
        ("config is no JSON", "config.json: is not JSON"),
        ("torn weights", "policy.safetensors: is not a safetensors file"),
        ("another version", "schema_version is 99"),
        ("no layout", "config.json: network or layout is damaged"),
        ("other columns", "other columns"),
        ("other sizes", "does not fit config.json"),
        ("weights that are no numbers", "not finite"),
    ],
)
def test_a_damaged_policy_is_one_line(policy, kind, message):
    _damage(policy[0], kind)
    with pytest.raises(InputError, match=message) as caught:
        LearnedAgent(policy[0])
    assert "\n" not in str(caught.value)


def test_a_missing_folder_is_one_line(tmp_path):
    with pytest.raises(InputError, match="does not exist"):
        LearnedAgent(tmp_path / "nothing")


def test_a_foreign_zip_is_not_even_opened_without_trust(tmp_path):
    path = tmp_path / "model.zip"
    path.write_bytes(b"not a zip")
    with pytest.raises(InputError, match="--trust"):
        LearnedAgent(path)


def test_a_trusted_zip_that_is_none_is_one_line(tmp_path):
    pytest.importorskip("sb3_contrib", reason="reading its zips needs sb3-contrib")
    path = tmp_path / "model.zip"
    path.write_bytes(b"not a zip")
    with pytest.raises(InputError, match="MaskablePPO cannot read it"):
        LearnedAgent(path, trust=True)


def test_a_zip_of_other_observations_is_one_line(tmp_path):
    contrib = pytest.importorskip("sb3_contrib", reason="reading its zips needs sb3-contrib")
    env = make_env(mask="legal")
    seen, _ = env.reset(seed=0)
    path = tmp_path / "model.zip"
    contrib.MaskablePPO("MultiInputPolicy", env, n_steps=8, batch_size=8, device="cpu").save(path)
    agent = LearnedAgent(path, trust=True)
    assert seen["action_mask"][agent.act(seen, {})] == 1
    # As of the version before items had limits.
    older = {**seen, "remaining": seen["remaining"][:, :8]}
    with pytest.raises(InputError, match=r"model.zip: was trained on .* 'remaining' is \(8, 11\)") as caught:
        agent.act(older, {})
    assert "\n" not in str(caught.value)
    env.close()


def test_a_package_that_is_not_installed_is_one_line(policy, monkeypatch):
    monkeypatch.setitem(sys.modules, "safetensors", None)
    monkeypatch.delitem(sys.modules, "packenv.agents.policy_files")
    with pytest.raises(InputError, match=r"a learned policy needs the package safetensors: pip install"):
        LearnedAgent(policy[0])
