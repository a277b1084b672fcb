"""The converter board of `deploy/board`: what `make board` writes and checks."""
