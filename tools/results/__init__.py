"""The tables of docs/results: figures are collected from LiveHand's own commands, and tables written from them."""
