"""The reasons why values differ: causes of the difference between data, data sheets and claims, and their probabilities."""
