"""Other methods than the avatar's, trained on the same captures and measured by the same evaluation."""
