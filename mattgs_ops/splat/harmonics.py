"""Real spherical harmonics up to degree 3, as splats store their colours (Kerbl et al. 2023).

Constants alone: for those who read splats without torch.
"""

SH_CONSTANT = 0.28209479177387814  # Y_0^0 = 1 / (2 √π): colour is 0.5 + this times sh_dc
SH_REST = 15  # coefficients of degree 1 to 3, always stored
