"""The material card in the input formats of FE codes, one module a code.

Each file states its units, the prestress, the stress and strain of its constants, and what it cannot carry (docs/fe_cards.md).
"""

from .fe_cards import CODES, FILES, limit_of_curves, missing_cards, write_fe_cards

__all__ = ["CODES", "FILES", "limit_of_curves", "missing_cards", "write_fe_cards"]
