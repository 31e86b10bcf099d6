"""The live page: a world in the browser, whose certified path follows what is dragged."""
