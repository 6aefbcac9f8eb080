"""Orders for episodes: drawn, fixed, replayed from files, or toys with a known perfect packing."""

from packenv.env.orders.choice import make_generator, next_order
from packenv.env.orders.from_names import ListedOrder, RandomOrders, ReplayedOrders
from packenv.env.orders.records import GeneratedOrder, OrderGenerator
from packenv.env.orders.spec import DEFAULT_SPEC, from_spec
from packenv.env.orders.toys import ToyOrders

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
