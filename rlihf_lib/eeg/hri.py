"""The ErrP-HRI recordings: download and verify (in preparation)."""
