"""Studies of methods on simulated captures: what a decoder owes to which of its parts."""
