"""The receiver, taken out of the checkout: a Python wheel and an npm package (docs/embed.md).

`api` is what the wheel promises, and `wheel` packs it; `npm` packs the page's receiver; `schema`
describes the events of both.
"""
