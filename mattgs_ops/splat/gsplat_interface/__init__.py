"""gsplat's interface to this engine, for those who write their own loss in torch.

``rasterization.rasterization`` is the function, ``arguments`` checks what it is given,
``drawing`` calls the compiled engine and ``composite`` connects it to torch's autograd.
docs/engine.md has the table of arguments.
"""
