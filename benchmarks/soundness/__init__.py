"""The soundness campaign: is anything that is called certified or proven wrong? ``python -m benchmarks.soundness``."""
