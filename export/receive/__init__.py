"""The receiver turns camera frames into a message.

`sources` opens a folder, video or camera; `receiver` calls the other stages in turn: `track` keeps
the display in sight, `clock` finds when it changes states, `states` puts the states together, and
`occlusion` erases covered blocks. `show` draws what was decided.
"""
