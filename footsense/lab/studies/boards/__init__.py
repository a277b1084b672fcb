"""Figures of one board that the pages `motion` and `motion-rows` share: feet in the pipeline and in the whole service."""
