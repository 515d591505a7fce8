"""The receiver turns camera frames into a message.

`sources` opens a folder, video or camera, and `receiver` takes its frames. `tracking` keeps the
display in sight, and `reader` reads it: `timing` finds when it changes states, `states` puts the
states together, `hidden` and `occlusion` erase what is not seen. `diagnosis` says why no message
came, and `show` draws what was decided.
"""
