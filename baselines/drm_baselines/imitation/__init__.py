"""Learning from a teacher who knows the payload: plans by convex programmes, imitated."""
