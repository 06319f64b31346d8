"""What keeps a registry true where nothing is recorded.

``orphans`` closes the runs that dead processes left open; ``moved`` finds the files of a folder
that was moved or copied.
"""
