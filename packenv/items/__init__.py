"""Items: the catalogue they are from, the shelf that loads what planning needs of them, their caches and checks.

May import io, planning's records and physics' item shapes; knows nothing of how an order is planned or executed.
"""
