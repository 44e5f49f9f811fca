"""How long work runs: where its tasks are done, how it is asked to stop, and how it goes on after a stop."""
