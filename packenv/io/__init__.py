"""Files, and nothing else: plans, executions, orders, containers, tables, rows of results, and the assets' places.

May import the records that files hold (geometry, planning, sim); knows nothing of catalogues, pages or pictures.
"""
