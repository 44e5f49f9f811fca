"""Problems that were written for other solvers: Minibex and AMPL's .nl, read into networks, and answers to write."""
