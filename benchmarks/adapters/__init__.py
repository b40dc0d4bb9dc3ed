"""Programs of others on the archive of scenes: each adapter reads pictures and writes layers."""
