"""Letters that LaTeX's fonts lack, written by what they have: so that a table compiles in any document."""

from __future__ import annotations

import re

RAISED = dict(zip("⁰¹²³⁴⁵⁶⁷⁸⁹⁺⁻ᵀ", "0123456789+-T", strict=True))
LOWERED = dict(zip("₀₁₂₃₄₅₆₇₈₉ₛ", "0123456789s", strict=True))
GREEK = {
    "α": r"\alpha", "β": r"\beta", "γ": r"\gamma", "δ": r"\delta", "ε": r"\varepsilon", "ζ": r"\zeta", "η": r"\eta",
    "θ": r"\theta", "κ": r"\kappa", "λ": r"\lambda", "μ": r"\mu", "µ": r"\mu", "ν": r"\nu", "ξ": r"\xi", "π": r"\pi",
    "ρ": r"\rho", "σ": r"\sigma", "τ": r"\tau", "φ": r"\varphi", "χ": r"\chi", "ψ": r"\psi", "ω": r"\omega",
    "Γ": r"\Gamma", "Δ": r"\Delta", "Θ": r"\Theta", "Λ": r"\Lambda", "Ξ": r"\Xi", "Π": r"\Pi", "Σ": r"\Sigma",
    "Φ": r"\Phi", "Ψ": r"\Psi", "Ω": r"\Omega",
}  # fmt: skip
SIGNS = {
    "≤": r"\leq", "≥": r"\geq", "≈": r"\approx", "≠": r"\neq", "±": r"\pm", "·": r"\cdot", "∞": r"\infty",
    "√": r"\sqrt{}", "∂": r"\partial", "∇": r"\nabla", "∫": r"\int", "→": r"\rightarrow", "∈": r"\in", "½": r"\frac12",
    "⋅": r"\cdot", "×": r"\times", "−": "-", "≪": r"\ll", "≫": r"\gg", "∝": r"\propto", "′": r"'",
}  # fmt: skip
MARKS = {"’": "'", "‘": "`", "“": "``", "”": "''", "…": r"\ldots{}", "\u2009": r"\,", "\u202f": r"\,", "\xa0": "~"}
RUNS = re.compile(f"[{''.join(RAISED)}]+|[{''.join(LOWERED)}]+")
LAST_OF_FONT = "\u017f"  # Latin-1 and Latin Extended-A, whose letters are put together from others


def with_letters_of_latex(latex: str) -> str:
    """Return LaTeX in which every letter can be set; one that nothing stands for becomes its number, as [U+2603]."""
    dotted = re.sub("(.)\N{COMBINING DOT ABOVE}", r"\\.{\1}", latex)
    raised = RUNS.sub(_script, dotted).replace(r"\textquotedbl{}", "''")  # which the encoding T1 alone has
    return "".join(letter if letter <= LAST_OF_FONT and letter not in SPECIAL else _sign(letter) for letter in raised)


SPECIAL = set(GREEK) | set(SIGNS) | set(MARKS)


def _script(run: re.Match[str]) -> str:
    raised = run[0][0] in RAISED
    digits = "".join((RAISED if raised else LOWERED)[letter] for letter in run[0])
    return rf"\ensuremath{{{{}}{'^' if raised else '_'}{{{digits}}}}}"


def _sign(letter: str) -> str:
    if letter in MARKS:
        return MARKS[letter]
    command = GREEK.get(letter) or SIGNS.get(letter)
    return rf"\ensuremath{{{command}}}" if command else f"[U+{ord(letter):04X}]"
