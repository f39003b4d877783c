"""The objects of the catalogue, a line each, for who only wants the list; the limit of a name."""

NAME_LIMIT = 80
"""Characters of an object's name, at most."""
BODY_NAMES: dict[str, str] = {
    "block": "block 60 x 80 x 120 mm [est]",
    "large_cylinder": "cylinder of diameter 70, height 120 mm [est]",
    "small_cylinder": "cylinder of diameter 40, height 90 mm [est]",
    "wedge": "triangular wedge, base 60 x 60, ridge at 100 mm [est]",
    "lightbulb": "A19 lightbulb, diameter 60, height 110 mm [sourced; profile est]",
    "funnel": "funnel, bowl 100 mm, 60 deg [sourced; stem est]",
    "wine_bottle": "wine bottle, diameter 73.6, height 322 mm [sourced; shoulder est]",
    "beer_bottle": "beer bottle, diameter 61, height 231 mm [sourced; shoulder est]",
    "coke_bottle": "coke bottle, height 197 mm [est]",
    "orangina_bottle": "orangina bottle, height 145 mm [est]",
}
