"""Other programs as trainers: the data that they read, their run, the splats that they leave.

``dataset.write_dataset`` writes training views for them, ``program`` finds and runs them,
``output.take_splats`` reads what they wrote, and ``train.operate`` is all of it, in a stage's
process. Nothing here imports the engine: a change of it repeats no other program's training.
"""
