"""KUKA RSI: telegrams, configuration and context, and the link that answers every cycle."""
