"""3D Gaussian splatting on a CPU: parameters, compiled engine, training, rendering."""
