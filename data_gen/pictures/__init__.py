"""Pictures to hide messages in: photographs, drawings, and their split into train and test."""
