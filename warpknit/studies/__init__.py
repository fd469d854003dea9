"""Many runs of one scene: contact maps (`warpknit map`), speed against accuracy (`warpknit trade`, `run --error`)."""
