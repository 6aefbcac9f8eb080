"""Orders for episodes: drawn, fixed, replayed from files, or toys with a known perfect packing."""

from packenv.order_generators.choice import make_generator, next_order
from packenv.order_generators.from_names import ListedOrder, RandomOrders, ReplayedOrders
from packenv.order_generators.records import GeneratedOrder, OrderGenerator
from packenv.order_generators.spec import DEFAULT_SPEC, from_spec
from packenv.order_generators.toys import ToyOrders

__all__ = [
    "DEFAULT_SPEC",
    "GeneratedOrder",
    "ListedOrder",
    "OrderGenerator",
    "RandomOrders",
    "ReplayedOrders",
    "ToyOrders",
    "from_spec",
    "make_generator",
    "next_order",
]
