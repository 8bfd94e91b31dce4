"""People outside the family of the shipped skins: phone films of them with their truth, and gates for `person`.

Truth is rendered by Cycles; what is measured against it is rendered by this software.
"""
