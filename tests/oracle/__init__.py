"""Independent derivations against which the engine is compared. Nothing here uses the engine."""
