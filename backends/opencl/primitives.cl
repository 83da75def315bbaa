/* SPDX-License-Identifier: Apache-2.0 */
/* Prefix sums and sorting. Work is divided into runs: worker r of w has the elements [n r / w, n (r + 1) / w).
   Everything is integer arithmetic in the order of the elements, so the result does not depend on the number of
   workers. lang.h is included before. */

DEVICE int run_begin(int n, int workers, int r) { return (int)((long)n * r / workers); }

KERNEL scan_sums(int workers, int n, GLOBAL const int *from, GLOBAL long *sum)
{
  FOR_EACH(r, workers) {
    long s = 0;
    int end = run_begin(n, workers, r + 1);
    for (int i = run_begin(n, workers, r); i < end; ++i) s += from[i];
    sum[r] = s;
  }
}

/* One work-group; sum [workers] becomes the start of each run. *overflow is set to 1 if the total exceeds 2^31 - 1. */
KERNEL scan_offsets(int workers, GLOBAL long *sum, GLOBAL int *overflow, __local long *part)
{
  int l = (int)get_local_id(0), w = (int)get_local_size(0), begin = run_begin(workers, w, l),
      end = run_begin(workers, w, l + 1);
  long s = 0;
  for (int i = begin; i < end; ++i) s += sum[i];
  part[l] = s;
  barrier(CLK_LOCAL_MEM_FENCE);
  s = 0;
  for (int i = 0; i < l; ++i) s += part[i];
  for (int i = begin; i < end; ++i) {
    long v = sum[i];
    sum[i] = s;
    s += v;
  }
  if (l == w - 1 && s > 0x7fffffffL) *overflow = 1;
}

KERNEL scan_write(int workers, int n, GLOBAL const int *from, GLOBAL const long *sum, GLOBAL int *to)
{
  FOR_EACH(r, workers) {
    long s = sum[r];
    int end = run_begin(n, workers, r + 1);
    for (int i = run_begin(n, workers, r); i < end; ++i) {
      to[i] = (int)s;
      s += from[i];
    }
    if (r == workers - 1) to[n] = (int)s;
  }
}

/* The whole scan in one work-group. */
KERNEL scan_small(int n, GLOBAL const int *from, GLOBAL int *to, GLOBAL int *overflow, __local long *part)
{
  int l = (int)get_local_id(0), w = (int)get_local_size(0), begin = run_begin(n, w, l), end = run_begin(n, w, l + 1);
  long s = 0;
  for (int i = begin; i < end; ++i) s += from[i];
  part[l] = s;
  barrier(CLK_LOCAL_MEM_FENCE);
  s = 0;
  for (int i = 0; i < l; ++i) s += part[i];
  for (int i = begin; i < end; ++i) {
    to[i] = (int)s;
    s += from[i];
  }
  if (l == w - 1) {
    to[n] = (int)s;
    if (s > 0x7fffffffL) *overflow = 1;
  }
}

/* count [digits x workers]: keys of each worker's run by digit. */
KERNEL sort_count(int workers, int n, int shift, int digits, GLOBAL const key64 *key, GLOBAL int *count)
{
  FOR_EACH(r, workers) {
    int end = run_begin(n, workers, r + 1);
    for (int d = 0; d < digits; ++d) count[d * workers + r] = 0;
    for (int i = run_begin(n, workers, r); i < end; ++i)
      ++count[(int)((key[i] >> shift) & (key64)(digits - 1)) * workers + r];
  }
}

/* place: the scan of count. Every worker moves its run in order, which keeps the sort stable. */
KERNEL sort_move(int workers, int n, int shift, int digits, GLOBAL const key64 *key, GLOBAL const int *value,
                 GLOBAL key64 *key_out, GLOBAL int *value_out, GLOBAL int *place)
{
  FOR_EACH(r, workers) {
    int end = run_begin(n, workers, r + 1);
    for (int i = run_begin(n, workers, r); i < end; ++i) {
      key64 k = key[i];
      int at = place[(int)((k >> shift) & (key64)(digits - 1)) * workers + r]++;
      key_out[at] = k;
      value_out[at] = value[i];
    }
  }
}

/* The whole sort in one work-item, for CPUs and few keys: `width` bits at a time. count: [2^width + 1]. */
KERNEL sort_small(int n, int bits, int width, GLOBAL key64 *key, GLOBAL int *value, GLOBAL key64 *key_out,
                  GLOBAL int *value_out, GLOBAL int *count)
{
  GLOBAL key64 *keys = key, *other_keys = key_out;
  GLOBAL int *values = value, *other_values = value_out;
  if (get_global_id(0) != 0) return;
  for (int shift = 0; shift < bits; shift += width) {
    int digits = 1 << min_int(width, bits - shift);
    for (int d = 0; d <= digits; ++d) count[d] = 0;
    for (int i = 0; i < n; ++i) ++count[(int)((keys[i] >> shift) & (key64)(digits - 1)) + 1];
    for (int d = 0; d < digits; ++d) count[d + 1] += count[d];
    for (int i = 0; i < n; ++i) {
      int at = count[(int)((keys[i] >> shift) & (key64)(digits - 1))]++;
      other_keys[at] = keys[i];
      other_values[at] = values[i];
    }
    GLOBAL key64 *k = keys;
    keys = other_keys;
    other_keys = k;
    GLOBAL int *v = values;
    values = other_values;
    other_values = v;
  }
  if (keys != key)
    for (int i = 0; i < n; ++i) {
      key[i] = keys[i];
      value[i] = values[i];
    }
}
