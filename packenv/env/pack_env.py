"""``RobotPack-v0``: the Gymnasium environment. Wiring only; docs/environment.md is its specification."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from copy import deepcopy
from operator import index
from typing import TYPE_CHECKING, Any, SupportsIndex, cast

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from packenv.env.arrangement import Landing
from packenv.env.config import PackConfig
from packenv.env.episode import Episode, Rules
from packenv.env.observation import Observation, Observer
from packenv.env.orders import GeneratedOrder, OrderGenerator, make_generator, next_order
from packenv.env.reward import Outcome, RewardFn, make_reward
from packenv.env.window import Window
from packenv.errors import InputError, check_known
from packenv.items.catalogue import open_catalogue
from packenv.items.shelf import ItemShelf
from packenv.types import Container, Order, Placement, Plan

if TYPE_CHECKING:
    from packenv.view.stage import Stage

_FRAME_SIZE = (480, 480)
"""Width and height of the pictures, px."""
_ITEM_MEMORY = 16 * 2**20
"""Bytes of meshes that an environment keeps; a scan takes 0.6 MB, and reading it a millisecond."""
_NO_ACTION = -1
"""What stands for an action that is no whole number."""


class PackEnv(gymnasium.Env[Observation, Any]):
    """Pack an order of real, non-convex items into a container, one item at a time.

    docs/environment.md says the same at length. Lengths are in m, masses in kg, angles in rad.

    ## Action space: ``Discrete(K + 1)``

    K is ``config["candidates"]``. ``k < K`` places the current item at row k of ``candidates``; ``K``
    defers it: to the end of the sequence (paper Alg. 4), when it is back to its next group of perturbed
    orientations, and after the last of them it is left over. An action is valid where the mask is 1.

    ## Observation space: ``Dict`` of float32 boxes

    - ``container`` (X, Y): container heightmap, the maximum of ``map_step`` × ``map_step`` cells, m.
    - ``item`` (P, 3, M, M): the current item at each stable pose: top and bottom heightmap, m, and share of
      the footprint.
    - ``candidates`` (K, 23): ``present``; ``x``, ``y``, ``z`` of its corner, m; ``length``, ``width``,
      ``height`` of its bounding box, m; ``yaw``, rad; ``pose``, index; its ``probability``; ``perturbed``,
      0 or 1; ``com_height``, m; ``support_margin``, m; then of HM, DBLF, MTA, MinZ and FirstFit
      ``score_<name>``, 0 (best) to 1, and ``rank_<name>`` among all legal candidates, from 0.
    - ``remaining`` (max_items, 11): of the items to come that are seen: ``present``; ``length``, ``width``,
      ``height``, m; ``volume``, m³; ``mass``, kg; ``share_filled``; ``deferred``; ``max_tilt``, rad: how far
      it may lean; ``bears``, kg: what may rest on it; ``refused``: the container takes it no more.
    - ``state`` (7,): ``length``, ``width``, ``height`` of the container, m; ``utilization``;
      ``packed_share``; ``left_share``; ``stage``: 0 first pass, 1 back again, 2 perturbed.
    - ``action_mask`` (K + 1,) int8.

    ## Masks

    ``config["mask"]``: ``legal``: free of overlap and inside the container; ``stable``: also the whole pile
    is in static equilibrium; ``robot``: also the robot can bring the item there. Under each of them limits of
    items hold. *Defer* is always allowed.

    ## Reward

    The sum of the terms, each in ``info`` as ``reward_<term>``: ``packed``, share of the order's items that
    was placed now; ``utilization``, share of the container's volume that was placed now; ``complete``, 1 at
    the end of a complete order; ``outside`` and ``collision``, negative, in physics; ``left_over``, weight
    0; ``invalid``, -0.1 for an invalid action, which changes nothing else. ``reward_fn`` gives other
    weights, or a reward of one's own.

    ## Start, termination, truncation

    An episode starts with an order of the ``order_generator`` and an empty container. It terminates when
    nothing is left to do; when an item is left over under ``on_infeasible="terminate"``; in physics, when
    robot or held item collide or an item lies beside the container. It is truncated after ``max_invalid``
    invalid actions in a row.

    ## Info

    ``action_mask`` (a fresh int8 array), ``invalid_action``, ``utilization``, ``packed_items``,
    ``items_left``, ``item``, ``instance``, ``order``, ``container``, ``stage``, ``drop`` and ``shift``
    (m, of the last placement in physics), ``collision``, ``outside``, ``left_over``, and ``reward_<term>``
    for every term.

    ## Version history

    - v0: first version.
    """

    metadata = {  # noqa: RUF012
        "render_modes": ["human", "rgb_array"],
        "render_fps": 4,
    }

    def __init__(
        self,
        config: PackConfig | Mapping[str, Any] | None = None,
        *,
        order_generator: OrderGenerator | Mapping[str, Any] | str | None = None,
        reward_fn: RewardFn | Mapping[str, float] | str | None = None,
        render_mode: str | None = None,
    ) -> None:
        """Open the catalogue; items are loaded when an order asks for them.

        Args:
            config: settings, or a mapping of those that differ from the defaults.
            order_generator: what makes the orders, or its specification, or its name as
                ``my_module:MyGenerator``; 10 random items where None.
            reward_fn: weights of the reward's terms; or a function from ``Outcome`` to a number or to named
                terms; or its name as ``my_module:my_reward``.
            render_mode: ``human``, ``rgb_array`` or None.

        Raises:
            InputError: a setting is wrong, or the catalogue cannot be used.
            PhysicsError: physics is asked for and its engine is not installed.
        """
        if render_mode is not None and render_mode not in self.metadata["render_modes"]:
            raise InputError(f"render_mode is {render_mode!r:.60}, give 'human', 'rgb_array' or None")
        self.config = config if isinstance(config, PackConfig) else PackConfig.from_mapping(config or {})
        if self.config.physics:
            from packenv.sim.engines import engine_config

            engine_config(self.config.engine)  # says now where there is none
        if not Window.possible():
            # Whoever tries every mode, as Gymnasium's checks do, tries those that work here.
            modes = [mode for mode in self.metadata["render_modes"] if mode != "human"]
            self.metadata = {**self.metadata, "render_modes": modes}
        self.render_mode = render_mode
        self._choices = (order_generator, reward_fn)
        self._reward = make_reward(reward_fn)
        self._observer = Observer(self.config)
        self.observation_space = cast("spaces.Space[Observation]", self._observer.space)
        self.action_space = spaces.Discrete(self.config.candidates + 1)
        catalogue = open_catalogue(self.config.catalogue, unit=self.config.unit, item_memory=_ITEM_MEMORY)
        # Physics knows convex parts alone, so planning must know them too.
        self._shelf = ItemShelf(catalogue, self.config.grid, "parts" if self.config.physics else "mesh")
        self._generator = make_generator(order_generator, catalogue)
        self._rules = Rules(self.config, self._shelf)
        self._limited: Rules | None = None
        self._episode: Episode | None = None
        self._drawn: tuple[GeneratedOrder, Container] | None = None
        self._actions: list[int] = []
        self._told: list[Placement] = []
        self._invalid_on_end = 0
        self._left_over_told = 0
        self._warned: set[tuple[float, float, float]] = set()
        self._stage: Stage | None = None
        self._window: Window | None = None

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Draw an order and a container, and offer the first item.

        Args:
            seed: of all chance.
            options: ``order``: item names of this episode's order in place of a drawn one; ``container``: its
                inner (length, width, height), m.

        Raises:
            InputError: an option is unknown, or the order or the container cannot be used.
        """
        given_order, given_container = _given(options or {})
        super().reset(seed=seed)
        which = int(self.np_random.integers(len(self.config.containers)))
        order = given_order or next_order(self._generator, self.np_random)
        container = given_container or order.container or Container(*self.config.containers[which])
        self._begin(order, container)
        if self.render_mode == "human":
            self.render()
        return self._observation(), self._info(False, Landing(), self._outcome(False, 0, None))

    def step(self, action: SupportsIndex) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Place the current item at a candidate, or defer it.

        Args:
            action: k < K: the candidate of row k; K: defer. Anything else, whole number or not, is invalid.
        """
        episode = self._running()
        try:
            chosen = index(action)
        except TypeError:
            chosen = _NO_ACTION
        self._actions.append(chosen)
        mask = episode.mask()
        valid = 0 <= chosen < len(mask) and bool(mask[chosen])
        self._invalid_on_end = 0 if valid else self._invalid_on_end + 1
        landing, outside = Landing(), episode.outside
        placed = 0
        if valid and not episode.ended:
            if chosen == self.config.candidates:
                episode.defer()
            else:
                landing, placed = episode.place(chosen), 1
        if self.render_mode == "human":
            self.render()
        outcome = self._outcome(not valid, placed, outside)
        info = self._info(not valid, landing, outcome)
        reward = float(sum(info[key] for key in info if key.startswith("reward_")))
        truncated = not episode.ended and self._invalid_on_end >= self.config.max_invalid
        return self._observation(), reward, episode.ended, truncated, info

    def render(self) -> Any:
        """Draw the container, its items and the robot.

        Returns:
            (480, 480, 3) uint8 in mode ``rgb_array``; None in ``human``, whose window shows the same.

        Raises:
            InputError: mode ``human`` without pygame or without a display.
        """
        if self.render_mode is None:
            gymnasium.logger.warn("render() without a render_mode: give render_mode='rgb_array' or 'human'")
            return None
        from packenv.view.stage import Stage

        episode = self._running()
        if self.render_mode == "human" and self._window is None:
            self._window = Window(_FRAME_SIZE, self.metadata["render_fps"])
        if self._stage is None or self._stage.cell.container != episode.container:
            self._stage = Stage(self._rules.options.setup.with_container(episode.container), _FRAME_SIZE)
        placed, joints = episode.scene()
        picture = self._stage.draw(placed, self._stage.home if joints is None else joints)
        if self._window is None:
            return picture
        self._window.show(picture)
        return None

    def action_masks(self) -> NDArray[np.bool_]:
        """(K + 1,) which actions are valid, for MaskablePPO."""
        return self._running().mask().astype(np.bool_)

    def plan(self) -> Plan:
        """What has been packed so far as a plan that can be written, viewed, verified and executed.

        Its poses are the planned ones, with physics too. Scores are those of the first heuristic column.
        """
        from packenv.env.episode_plan import episode_plan

        return episode_plan(self._running())

    def close(self) -> None:
        """Free what the episode holds; twice is fine."""
        self._end_episode()
        if self._window is not None:
            self._window.close()
            self._window = None

    def __getstate__(self) -> dict[str, Any]:
        """Settings, chance, and the episode as its order and its actions so far."""
        return {
            "choices": (self.config, *self._choices, self.render_mode),
            "spec": self.spec,
            "random": (self._np_random, self._np_random_seed),
            "drawn": self._drawn if self._episode is not None else None,
            "actions": list(self._actions),
        }

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Make the environment again, and repeat the episode up to where it was."""
        config, order_generator, reward_fn, render_mode = state["choices"]
        PackEnv.__init__(
            self, config, order_generator=order_generator, reward_fn=reward_fn, render_mode=render_mode
        )
        self.spec = state["spec"]
        if state["drawn"] is not None:
            self._begin(*state["drawn"])
            for action in state["actions"]:
                self.step(action)
        self._np_random, self._np_random_seed = state["random"]

    def _running(self) -> Episode:
        if self._episode is None:
            raise gymnasium.error.ResetNeeded("call reset() first: there is no episode")
        return self._episode

    def _end_episode(self) -> None:
        if self._episode is not None:
            self._episode.close()
            self._episode = None

    def _begin(self, order: GeneratedOrder, container: Container) -> None:
        """Start an episode."""
        self._end_episode()
        fits = all(a <= b + 1e-9 for a, b in zip(container.size, self._observer.largest, strict=True))
        if not fits:
            raise InputError(
                f"the order's container {container.label} is larger than those of the configuration "
                f"({'x'.join(f'{s:g}' for s in self._observer.largest)}): name its size in containers"
            )
        rules = self._rules_for(order)
        self._drawn = (order, container)
        self._actions, self._told, self._invalid_on_end, self._left_over_told = [], [], 0, 0
        self._episode = Episode(self.config, rules, container, order.items)
        why = self._episode.barrier
        if why is not None and container.size not in self._warned:
            self._warned.add(container.size)
            gymnasium.logger.warn(f"nothing can be packed, so the episode ends at its first step: {why}")

    def _rules_for(self, order: GeneratedOrder) -> Rules:
        """The rules of an order; those that it sets itself are kept for the next one that sets the same."""
        self._shelf.bring(order.meshes)
        self._shelf.check_known((*order.items, *order.limits))
        if not order.limits:
            return self._rules
        if self._limited is None or order.meshes or self._limited.limits != order.limits:
            self._limited = Rules(self.config, self._shelf.with_limits(order.limits), order.limits)
        return self._limited

    def _observation(self) -> Observation:
        episode = self._running()
        return self._observer.observe(episode.view(), episode.mask())

    def _outcome(self, invalid: bool, placed: int, before: frozenset[int] | None) -> Outcome:
        """What came of an action; ``before`` tells what was outside before it, None before any action."""
        episode = self._running()
        sequence, container = episode.sequence, episode.container
        gone = 0 if before is None else len(sequence.left_over) - self._left_over_told
        self._left_over_told += gone
        before = before or frozenset()

        def volume(indices: frozenset[int]) -> float:
            names = (episode.placements[k].item for k in indices)
            return sum(episode.shelf.items[name].volume for name in names) / container.volume

        newest = frozenset(range(len(episode.placements) - placed, len(episode.placements)))
        self._told += deepcopy(episode.placements[len(self._told) :])
        return Outcome(
            invalid=invalid,
            placed=placed,
            placed_volume=volume(newest),
            outside=len(episode.outside) - len(before),
            outside_volume=volume(episode.outside - before) - volume(before - episode.outside),
            collided=episode.collided,
            left_over=gone,
            ended=episode.ended,
            complete=len(episode.inside) == len(episode.names) and not episode.collided,
            pieces=len(episode.names),
            placements=tuple(self._told),
            heights=episode.arrangement.pile.surface.heights.copy(),
        )

    def _info(self, invalid: bool, landing: Landing, outcome: Outcome) -> dict[str, Any]:
        episode = self._running()
        sequence = episode.sequence
        current = sequence.current
        return {
            "action_mask": episode.mask(),
            "invalid_action": invalid,
            "utilization": episode.utilization,
            "packed_items": len(episode.inside),
            "items_left": sequence.waiting,
            "item": None if current is None else current.item,
            "instance": 0 if current is None else current.instance,
            "order": () if self.config.arrivals == "online" else episode.names,
            "container": episode.container.label,
            "stage": sequence.stage,
            "drop": landing.drop,
            "shift": landing.shift,
            "collision": episode.collided,
            "outside": [episode.placements[k].item for k in sorted(episode.outside)],
            "left_over": [piece.item for piece in sequence.left_over],
            **{f"reward_{name}": float(term) for name, term in self._reward(outcome).items()},
        }


def _given(options: Mapping[str, Any]) -> tuple[GeneratedOrder | None, Container | None]:
    """The order and the container that the options of a reset name.

    Raises:
        InputError: an option is unknown, or none.
    """
    check_known(options, ("order", "container"), "reset: options has no key", "it has")
    names, size = options.get("order"), options.get("container")
    order = container = None
    if names is not None:
        if isinstance(names, str) or not isinstance(names, Iterable):
            raise InputError(
                f"reset: order is {names!r:.60}, give a list of item names such as ['mug', 'bowl']"
            )
        order = GeneratedOrder(Order.of(*names).names)
    if size is not None:
        lengths = tuple(size) if isinstance(size, Iterable) and not isinstance(size, str) else ()
        if len(lengths) != 3:
            raise InputError(
                f"reset: container is {size!r:.60}, give three lengths in m such as [0.32, 0.32, 0.3]"
            )
        container = Container(*lengths)
    return order, container
