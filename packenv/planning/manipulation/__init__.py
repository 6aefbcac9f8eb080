"""Whether the robot can put an item there from above: where the cup holds it, and the arm's way down.

May import robot, geometry and the search's container map; knows nothing of stability.
"""
