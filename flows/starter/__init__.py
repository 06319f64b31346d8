"""``mattgs init``: a benchmark of one's own captures, its gate in CI and its schedule, as files.

``write`` finds the captures and writes the files; ``templates/`` holds their text.
"""
