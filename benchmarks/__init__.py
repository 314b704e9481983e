"""Run time against error, beside every peer, in one run."""
