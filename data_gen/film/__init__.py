"""Films: rooms, a hand that holds the camera, and a display that runs free of it."""
