"""The placement network as MaskablePPO wants it.

Stable-Baselines3 flattens float images into an MLP without a word; here its features extractor is the
network's encoder, and its action and value nets are the network's heads.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import torch
from gymnasium import spaces
from sb3_contrib.common.maskable.policies import MaskableMultiInputActorCriticPolicy
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from torch import Tensor, nn

from packenv.agents.placement_network import (
    Actor,
    Critic,
    Encoder,
    Encoding,
    NetworkConfig,
    ObservationLayout,
    PlacementNetwork,
)


class PlacementExtractor(BaseFeaturesExtractor):
    """The network's encoder; its features are the context, then the candidates' rows, in one flat vector."""

    def __init__(
        self, observation_space: spaces.Dict, layout: ObservationLayout, network: NetworkConfig
    ) -> None:
        """Build the encoder for an observation space of RobotPack-v0."""
        encoder = Encoder(layout, network)
        (rows, _) = observation_space["candidates"].shape or (0, 0)
        super().__init__(observation_space, network.context + rows * encoder.candidate_size)
        self.encoder = encoder

    def forward(self, observations: dict[str, Tensor]) -> Tensor:
        """Features (b, context + k · candidate size)."""
        encoding = self.encoder(observations)
        return torch.cat((encoding.context, encoding.candidates.flatten(1)), dim=1)


class PlacementPolicy(MaskableMultiInputActorCriticPolicy):
    """Actor and critic on the placement network."""

    def __init__(
        self,
        observation_space: spaces.Dict,
        action_space: spaces.Discrete,
        lr_schedule: Callable[[float], float],
        layout: ObservationLayout,
        network: NetworkConfig,
        **options: Any,
    ) -> None:
        """Build the policy.

        Args:
            observation_space: of RobotPack-v0.
            action_space: likewise.
            lr_schedule: learning rate by what remains of the training, 1 to 0.
            layout: of the observations.
            network: sizes.
            options: what Stable-Baselines3 adds of its own.
        """
        self._layout, self._sizes = layout, network
        # These follow from the network; a policy that is loaded from a file brings them along.
        for name in ("features_extractor_class", "features_extractor_kwargs", "net_arch", "ortho_init"):
            options.pop(name, None)
        super().__init__(
            observation_space,
            action_space,
            lr_schedule,
            net_arch=[],
            ortho_init=False,
            features_extractor_class=PlacementExtractor,
            features_extractor_kwargs={"layout": layout, "network": network},
            **options,
        )

    def _get_constructor_parameters(self) -> dict[str, Any]:
        return {**super()._get_constructor_parameters(), "layout": self._layout, "network": self._sizes}

    def _build(self, lr_schedule: Callable[[float], float]) -> None:
        assert isinstance(self.features_extractor, PlacementExtractor)
        size = self.features_extractor.encoder.candidate_size
        self.mlp_extractor = _Pass(self.features_dim)
        self.action_net = _ActorOfFeatures(Actor(size, self._sizes), self._sizes.context, size)
        self.value_net = _CriticOfFeatures(Critic(self._sizes), self._sizes.context)
        self.optimizer = self.optimizer_class(self.parameters(), lr=lr_schedule(1.0), **self.optimizer_kwargs)

    def placement_network(self) -> PlacementNetwork:
        """The network on its own, with the weights of now (shared, not copied)."""
        network = PlacementNetwork(self._layout, self._sizes)
        network.encoder = self.features_extractor.encoder
        network.actor = self.action_net.actor
        network.critic = self.value_net.critic
        return network


class _Pass(nn.Module):
    """Hands the features on to both heads."""

    def __init__(self, size: int) -> None:
        super().__init__()
        self.latent_dim_pi = self.latent_dim_vf = size

    def forward(self, features: Tensor) -> tuple[Tensor, Tensor]:
        return features, features

    def forward_actor(self, features: Tensor) -> Tensor:
        return features

    def forward_critic(self, features: Tensor) -> Tensor:
        return features


class _ActorOfFeatures(nn.Module):
    def __init__(self, actor: Actor, context: int, candidate_size: int) -> None:
        super().__init__()
        self.actor = actor
        self._context, self._size = context, candidate_size

    def forward(self, features: Tensor) -> Tensor:
        context, rows = features[:, : self._context], features[:, self._context :]
        logits: Tensor = self.actor(Encoding(context, rows.unflatten(1, (-1, self._size))))
        return logits


class _CriticOfFeatures(nn.Module):
    def __init__(self, critic: Critic, context: int) -> None:
        super().__init__()
        self.critic = critic
        self._context = context

    def forward(self, features: Tensor) -> Tensor:
        value: Tensor = self.critic(features[:, : self._context])
        return value
