"""trailmark's version, for those parts that must not import the whole."""

__all__ = ["__version__"]

__version__ = "0.1.0"
