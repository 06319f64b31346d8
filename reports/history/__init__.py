"""A benchmark's history: how each metric of each cell went over runs and commits.

``series`` orders runs into points, ``steps`` finds where a level changed for good, ``charts`` draws
one small chart per metric, ``page`` puts all of them on one page.
"""
