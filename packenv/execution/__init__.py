"""Plans and physics together: planning with physics' answers, rehearsing a plan, carrying it out, closed loop.

And without physics: a plan as motions of a robot (``trajectories``).

May import items, planning, robot and sim; knows nothing of pictures, of commands or of the environment.
"""
