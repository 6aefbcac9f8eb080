"""Whether a pile stands still: contacts between exact surfaces, force balance, and its margin.

May import geometry and the search's container map; knows nothing of the robot.
"""
