"""How visible messages are: presets, line codes at equal visibility, and a page that flickers."""
