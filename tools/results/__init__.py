"""The pages of docs/results: their figures are collected from LiveHand's own commands, and their tables written from them."""
