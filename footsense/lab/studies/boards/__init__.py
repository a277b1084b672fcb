"""Figures of the boards on the page `motion`: feet in the pipeline and in the whole service."""
