"""Studies of what people see of a message, and of what hides it."""
