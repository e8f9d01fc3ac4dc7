"""KUKA RSI: the set-up of the controller, checked and made."""
