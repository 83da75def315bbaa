/* SPDX-License-Identifier: Apache-2.0 */
/* Prefix sums and sorting. On CPUs work is divided into runs: worker r of w has the elements [n r / w, n (r + 1) / w).
   On GPUs a work-group has a chunk. Everything is integer arithmetic in the order of the elements, so the result does
   not depend on the number of workers. lang.h is included before. */

#define MAX_ITEMS 128 /* of a work-group; opencl_backend.cpp knows it, SORT_BITS and SORT_RUN */

DEVICE int run_begin(int n, int workers, int r) { return (int)((long)n * r / workers); }

/* Of a work-item: the sum of `own` over the work-items before it. part [MAX_ITEMS]: afterwards the sums up to each and
   with it. */
DEVICE long sum_before(long own, __local long *part)
{
  int l = (int)get_local_id(0), w = (int)get_local_size(0);
  barrier(CLK_LOCAL_MEM_FENCE);
  part[l] = own;
  barrier(CLK_LOCAL_MEM_FENCE);
  for (int distance = 1; distance < w; distance *= 2) {
    long before = l >= distance ? part[l - distance] : 0;
    barrier(CLK_LOCAL_MEM_FENCE);
    part[l] += before;
    barrier(CLK_LOCAL_MEM_FENCE);
  }
  return part[l] - own;
}

/* By a work-group: to[i] = before + the sum of from[0 .. i), i < n; returns before + the sum of all. */
DEVICE long scan_run(int n, long before, GLOBAL const int *from, GLOBAL int *to, __local long *part)
{
  int l = (int)get_local_id(0), w = (int)get_local_size(0), begin = run_begin(n, w, l), end = run_begin(n, w, l + 1);
  long s = 0;
  for (int i = begin; i < end; ++i) s += from[i];
  s = before + sum_before(s, part);
  for (int i = begin; i < end; ++i) {
    to[i] = (int)s;
    s += from[i];
  }
  return before + part[w - 1];
}

/* The whole scan in one work-group. *overflow is set to 1 if the total exceeds 2^31 - 1. */
KERNEL scan_small(int n, GLOBAL const int *from, GLOBAL int *to, GLOBAL int *overflow)
{
  __local long part[MAX_ITEMS];
  long total = scan_run(n, 0, from, to, part);
  if (get_local_id(0) != 0) return;
  to[n] = (int)total;
  if (total > 0x7fffffffL) *overflow = 1;
}

/* The sum of each run. */
KERNEL scan_sums(int workers, int n, GLOBAL const int *from, GLOBAL long *sum)
{
  FOR_EACH(r, workers) {
    long s = 0;
    int end = run_begin(n, workers, r + 1);
    for (int i = run_begin(n, workers, r); i < end; ++i) s += from[i];
    sum[r] = s;
  }
}

/* One work-group; sum [count] becomes the start of each run, or chunk. */
KERNEL scan_offsets(int count, GLOBAL long *sum, GLOBAL int *overflow)
{
  __local long part[MAX_ITEMS];
  int l = (int)get_local_id(0), w = (int)get_local_size(0), begin = run_begin(count, w, l),
      end = run_begin(count, w, l + 1);
  long s = 0;
  for (int i = begin; i < end; ++i) s += sum[i];
  s = sum_before(s, part);
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

/* The sum of each chunk, a work-group's. */
KERNEL chunk_sums(int n, int chunk, GLOBAL const int *from, GLOBAL long *sum)
{
  __local long part[MAX_ITEMS];
  int g = (int)get_group_id(0), l = (int)get_local_id(0), w = (int)get_local_size(0),
      end = min_int(n - chunk * g, chunk);
  long s = 0;
  for (int i = l; i < end; i += w) s += from[chunk * g + i];
  sum_before(s, part);
  if (l == 0) sum[g] = part[w - 1];
}

/* The scan of each chunk, a work-group's. sum: of the chunks, or with `offsets` their starts. */
KERNEL scan_chunks(int n, int chunk, int offsets, GLOBAL const int *from, GLOBAL const long *sum, GLOBAL int *to,
                   GLOBAL int *overflow)
{
  __local long part[MAX_ITEMS];
  int g = (int)get_group_id(0), l = (int)get_local_id(0), w = (int)get_local_size(0);
  long s = 0;
  if (offsets) {
    s = sum[g];
  } else {
    for (int i = l; i < g; i += w) s += sum[i];
    sum_before(s, part);
    s = part[w - 1];
  }
  s = scan_run(min_int(n - chunk * g, chunk), s, from + chunk * g, to + chunk * g, part);
  if (l != 0 || g + 1 < (int)get_num_groups(0)) return;
  to[n] = (int)s;
  if (s > 0x7fffffffL) *overflow = 1;
}

DEVICE int sort_digit(key64 key, int shift, int digits) { return (int)((key >> shift) & (key64)(digits - 1)); }

/* count [digits x workers]: keys of each worker's run by digit. */
KERNEL sort_count(int workers, int n, int shift, int digits, GLOBAL const key64 *key, GLOBAL int *count)
{
  FOR_EACH(r, workers) {
    int end = run_begin(n, workers, r + 1);
    for (int d = 0; d < digits; ++d) count[d * workers + r] = 0;
    for (int i = run_begin(n, workers, r); i < end; ++i) ++count[sort_digit(key[i], shift, digits) * workers + r];
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
      int at = place[sort_digit(k, shift, digits) * workers + r]++;
      key_out[at] = k;
      value_out[at] = value[i];
    }
  }
}

/* The whole sort in one work-item, for CPUs: `width` bits at a time. count: [2^width + 1]. */
KERNEL sort_small(int n, int bits, int width, GLOBAL key64 *key, GLOBAL int *value, GLOBAL key64 *key_out,
                  GLOBAL int *value_out, GLOBAL int *count)
{
  GLOBAL key64 *keys = key, *other_keys = key_out;
  GLOBAL int *values = value, *other_values = value_out;
  if (get_global_id(0) != 0) return;
  for (int shift = 0; shift < bits; shift += width) {
    int digits = 1 << min_int(width, bits - shift);
    for (int d = 0; d <= digits; ++d) count[d] = 0;
    for (int i = 0; i < n; ++i) ++count[sort_digit(keys[i], shift, digits) + 1];
    for (int d = 0; d < digits; ++d) count[d + 1] += count[d];
    for (int i = 0; i < n; ++i) {
      int at = count[sort_digit(keys[i], shift, digits)]++;
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

/* A GPU sorts SORT_BITS bits at a time. Item l of a group has the SORT_RUN keys of its chunk from SORT_RUN l on. */
#define SORT_BITS 6
#define SORT_DIGITS (1 << SORT_BITS)
#define SORT_RUN 16

/* place[d w + l]: where in the chunk, of `many` keys, the first key of item l, of w, with digit d goes. place:
   [SORT_DIGITS MAX_ITEMS], part: [MAX_ITEMS]. */
DEVICE void sort_places(int many, int shift, int digits, GLOBAL const key64 *key, __local ushort *place,
                        __local long *part)
{
  int l = (int)get_local_id(0), w = (int)get_local_size(0), s = 0;
  for (int d = 0; d < digits; ++d) place[d * w + l] = 0;
  for (int i = SORT_RUN * l; i < min_int(SORT_RUN * (l + 1), many); ++i)
    ++place[sort_digit(key[i], shift, digits) * w + l];
  barrier(CLK_LOCAL_MEM_FENCE);
  for (int c = digits * l; c < digits * (l + 1); ++c) s += place[c];
  s = (int)sum_before(s, part);
  for (int c = digits * l; c < digits * (l + 1); ++c) {
    int own = place[c];
    place[c] = (ushort)s;
    s += own;
  }
  barrier(CLK_LOCAL_MEM_FENCE);
}

/* count [digits x groups]: keys of each chunk by digit. */
KERNEL sort_chunks_count(int n, int shift, int digits, GLOBAL const key64 *key, GLOBAL int *count)
{
  __local int own[SORT_DIGITS];
  int g = (int)get_group_id(0), l = (int)get_local_id(0), w = (int)get_local_size(0), first = SORT_RUN * w * g,
      many = min_int(n - first, SORT_RUN * w);
  for (int d = l; d < digits; d += w) own[d] = 0;
  barrier(CLK_LOCAL_MEM_FENCE);
  for (int i = l; i < many; i += w) atomic_inc(own + sort_digit(key[first + i], shift, digits));
  barrier(CLK_LOCAL_MEM_FENCE);
  for (int d = l; d < digits; d += w) count[d * (int)get_num_groups(0) + g] = own[d];
}

/* start: the scan of count. */
KERNEL sort_chunks_move(int n, int shift, int digits, GLOBAL const key64 *key, GLOBAL const int *value,
                        GLOBAL key64 *key_out, GLOBAL int *value_out, GLOBAL const int *start)
{
  __local ushort place[SORT_DIGITS * MAX_ITEMS];
  __local long part[MAX_ITEMS];
  __local int from_place[SORT_DIGITS]; /* to the place among all keys */
  int g = (int)get_group_id(0), l = (int)get_local_id(0), w = (int)get_local_size(0), first = SORT_RUN * w * g,
      many = min_int(n - first, SORT_RUN * w);
  sort_places(many, shift, digits, key + first, place, part);
  for (int d = l; d < digits; d += w) from_place[d] = start[d * (int)get_num_groups(0) + g] - place[d * w];
  barrier(CLK_LOCAL_MEM_FENCE);
  for (int i = SORT_RUN * l; i < min_int(SORT_RUN * (l + 1), many); ++i) {
    key64 k = key[first + i];
    int d = sort_digit(k, shift, digits), at = from_place[d] + place[d * w + l]++;
    key_out[at] = k;
    value_out[at] = value[first + i];
  }
}

/* The whole sort of one chunk. */
KERNEL sort_chunk(int n, int bits, GLOBAL key64 *key, GLOBAL int *value, GLOBAL key64 *key_out, GLOBAL int *value_out)
{
  __local ushort place[SORT_DIGITS * MAX_ITEMS];
  __local long part[MAX_ITEMS];
  GLOBAL key64 *keys = key, *other_keys = key_out;
  GLOBAL int *values = value, *other_values = value_out;
  int l = (int)get_local_id(0), w = (int)get_local_size(0), begin = SORT_RUN * l, end = min_int(SORT_RUN * (l + 1), n);
  for (int shift = 0; shift < bits; shift += SORT_BITS) {
    int digits = 1 << min_int(SORT_BITS, bits - shift);
    sort_places(n, shift, digits, keys, place, part);
    for (int i = begin; i < end; ++i) {
      int at = place[sort_digit(keys[i], shift, digits) * w + l]++;
      other_keys[at] = keys[i];
      other_values[at] = values[i];
    }
    barrier(CLK_LOCAL_MEM_FENCE | CLK_GLOBAL_MEM_FENCE);
    GLOBAL key64 *k = keys;
    keys = other_keys;
    other_keys = k;
    GLOBAL int *v = values;
    values = other_values;
    other_values = v;
  }
  if (keys != key)
    for (int i = begin; i < end; ++i) {
      key[i] = keys[i];
      value[i] = values[i];
    }
}
