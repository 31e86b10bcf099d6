"""Programs that measure trailmark, and the worlds and the referee that they share with the tests."""
