"""A person's model as pictures show it: rendered in their light, of skin by numbers, and the flow between both."""
