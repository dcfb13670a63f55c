"""Small linear systems on lanes: LU with partial pivoting, rows exchanged by select.

Golub and Van Loan, Matrix Computations, 3.4. Every lane has pivots of its own; a singular lane
gets inf or NaN, and its mates nothing of it.
"""

from .library import qualified

LINEAR = """
fn void lu_factor(V* a, M* rows, V* sign, int n) {
  for (int i = 0; i < n; ++i) rows[i] = isplat(i);
  *sign = splat(1.0);
  for (int k = 0; k < n; ++k) {
    V best = abs_(a[k * n + k]);
    M pivot = isplat(k);
    for (int i = k + 1; i < n; ++i) {
      V size = abs_(a[i * n + k]);
      M larger = gt(size, best);
      best = sel(larger, size, best);
      pivot = isel(larger, isplat(i), pivot);
    }
    for (int i = k + 1; i < n; ++i) {
      M here = ieq(pivot, isplat(i));
      for (int j = 0; j < n; ++j) {
        V upper = a[k * n + j], lower = a[i * n + j];
        a[k * n + j] = sel(here, lower, upper);
        a[i * n + j] = sel(here, upper, lower);
      }
      M upper = rows[k], lower = rows[i];
      rows[k] = isel(here, lower, upper);
      rows[i] = isel(here, upper, lower);
      *sign = sel(here, -*sign, *sign);
    }
    V scale = splat(1.0) / a[k * n + k];
    for (int i = k + 1; i < n; ++i) {
      V factor = a[i * n + k] * scale;
      a[i * n + k] = factor;
      for (int j = k + 1; j < n; ++j) a[i * n + j] = fma(-factor, a[k * n + j], a[i * n + j]);
    }
  }
}
fn void lu_solve(const V* lu, const M* rows, V* x, V* room, int n, int k) {
  for (int i = 0; i < n; ++i)
    for (int c = 0; c < k; ++c) {
      V got = splat(0.0);
      for (int j = 0; j < n; ++j) got = sel(ieq(rows[i], isplat(j)), x[j * k + c], got);
      for (int j = 0; j < i; ++j) got = fma(-lu[i * n + j], room[j * k + c], got);
      room[i * k + c] = got;
    }
  for (int i = n - 1; i >= 0; --i)
    for (int c = 0; c < k; ++c) {
      V got = room[i * k + c];
      for (int j = i + 1; j < n; ++j) got = fma(-lu[i * n + j], x[j * k + c], got);
      x[i * k + c] = got / lu[i * n + i];
    }
}
fn void lu_adjoint_solve(const V* lu, const M* rows, V* x, V* room, int n, int k) {
  for (int i = 0; i < n; ++i)
    for (int c = 0; c < k; ++c) {
      V got = x[i * k + c];
      for (int j = 0; j < i; ++j) got = fma(-lu[j * n + i], room[j * k + c], got);
      room[i * k + c] = got / lu[i * n + i];
    }
  for (int i = n - 1; i >= 0; --i)
    for (int c = 0; c < k; ++c) {
      V got = room[i * k + c];
      for (int j = i + 1; j < n; ++j) got = fma(-lu[j * n + i], room[j * k + c], got);
      room[i * k + c] = got;
    }
  for (int j = 0; j < n; ++j)
    for (int c = 0; c < k; ++c) {
      V got = splat(0.0);
      for (int i = 0; i < n; ++i) got = sel(ieq(rows[i], isplat(j)), room[i * k + c], got);
      x[j * k + c] = got;
    }
}
"""


def linear_library(lanes: int, qualifier: str = "") -> str:
    """The functions, each with a qualifier before its type."""
    return qualified(LINEAR, lanes, qualifier)
