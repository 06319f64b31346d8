"""The command line ``mattgs``: ``app`` holds the commands, the other modules groups of them.

``run`` runs one benchmark, ``gate`` compares with a baseline, ``results`` exports and promotes
runs, ``operate`` cleans and serves, ``options`` merges options with a TOML file, ``terminal`` and
``status`` show progress. Public face: ``app.main``.
"""
