"""Whether a plan is what it claims: exact meshes, then stability and reach, as one report.

May import items, planning, robot and geometry. ``exact_meshes`` shares no code path with planning's test of
legality. The room is not called ``verify``: that is the function ``packenv.verify``.
"""
