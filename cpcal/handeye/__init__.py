"""Robot-world hand-eye calibration from pixels: `x_ij = E H_i F p_j`, with a proved bracket of its largest error."""
