"""Made the files of the avatars that ship."""
