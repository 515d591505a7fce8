"""Follow the display from frame to frame: by ratex patches, or by pilots."""
