"""From an order to a plan that is verified, carried out in physics, and looked at in a browser."""

import packenv as rp

catalogue = rp.load_catalogue("builtin")
order = rp.Order.of("mug", "bowl", "banana")
plan = rp.plan(order, rp.Container(0.32, 0.32, 0.30), catalogue)
assert rp.verify(plan, catalogue).ok
execution = rp.execute(plan, catalogue, feel=True)
rp.show(plan, "plan.html")

assert execution.success, execution.verdict
print(f"{len(plan.placements)} items packed and placed; open plan.html")
