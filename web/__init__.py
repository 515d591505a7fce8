"""The receiver as a web page: what builds it from the models and the JavaScript beside it."""
