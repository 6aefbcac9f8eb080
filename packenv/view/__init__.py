"""What people look at: the page, pictures, animations and 3D files of plans and executions.

May import execution, items, io and robot; the command line, the API and the environment show it.
"""
