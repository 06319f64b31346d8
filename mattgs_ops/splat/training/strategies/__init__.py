"""How the set of splats changes while it is trained.

``gradient`` clones and splits where the positional gradient is high (Kerbl et al. 2023, AbsGS, a
budgeted growth) and prunes as MATT-GS does; ``mcmc`` relocates dead splats and shakes the others
(Kheradmand et al. 2024). :class:`base.Strategy` is what the trainer knows of them.
"""
