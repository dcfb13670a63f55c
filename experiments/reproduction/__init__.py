"""The paper again: jobs, results, tables, claims, golden runs."""
