"""Pack meshes of your own: anything that trimesh loads or makes. Here three parts, modelled in millimetres."""

import trimesh

import packenv as rp

tray = trimesh.creation.box((120.0, 80.0, 30.0))
can = trimesh.creation.cylinder(radius=33.0, height=115.0)
ring = trimesh.creation.annulus(r_min=20.0, r_max=40.0, height=25.0)

catalogue = rp.load_catalogue({"tray": tray, "can": can, "ring": ring}, unit="mm")
order = rp.Order.of("tray", "can", "can", "ring")
plan = rp.plan(order, rp.Container(0.25, 0.20, 0.15), catalogue)
rp.show(plan, "parts.glb")

assert plan.complete, plan.leftovers
assert rp.verify(plan, catalogue).ok
packed = trimesh.load("parts.glb")
assert (packed.bounds[0] > -1e-6).all()
assert (packed.bounds[1] < [0.250001, 0.200001, 0.150001]).all()
for placement in plan.placements:
    print(f"{placement.item:<5} at {placement.corner.round(3)} m")
