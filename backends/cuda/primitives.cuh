// SPDX-License-Identifier: Apache-2.0
// Kernels of the CUDA backend itself: scans, short copies and fills, answers to the host.
#pragma once
#include <cub/cub.cuh>

#include "device/for_backends.hpp"

namespace cama {
namespace {

struct AddLong {
  __host__ __device__ long long operator()(long long a, long long b) const { return a + b; }
};

constexpr int block_scan_threads = 1024, block_scan_items = 4;
constexpr int scan_chunk = block_scan_threads * block_scan_items, longest_block_scan = 4 * scan_chunk;
constexpr int most_chunks = block_scan_threads;  // of a list whose chunks are scanned by a block each

/// Exclusive sums of a short list by one block, in one launch instead of five; a total beyond 2^31 raises the flag.
__global__ void __launch_bounds__(block_scan_threads) scan_by_block(int n, const int *from, int *to, int *overflow)
{
  using Scan = cub::BlockScan<long long, block_scan_threads>;
  __shared__ typename Scan::TempStorage storage;
  AWAIT_LAUNCHES;
  long long before = 0;
  for (int begin = 0; begin < n; begin += block_scan_threads * block_scan_items) {
    long long value[block_scan_items], total;
    const int first = begin + static_cast<int>(threadIdx.x) * block_scan_items;
    for (int k = 0; k < block_scan_items; ++k) value[k] = first + k < n ? from[first + k] : 0;
    Scan(storage).ExclusiveSum(value, value, total);
    for (int k = 0; k < block_scan_items; ++k)
      if (first + k < n) to[first + k] = static_cast<int>(before + value[k]);
    before += total;
    __syncthreads();
  }
  if (threadIdx.x > 0) return;
  to[n] = static_cast<int>(before);
  if (before > 0x7fffffffll) *overflow = 1;
}

/// sum[c] of chunk c, a block's.
__global__ void __launch_bounds__(block_scan_threads) sum_chunks(int n, const int *from, long long *sum)
{
  using Reduce = cub::BlockReduce<long long, block_scan_threads>;
  __shared__ typename Reduce::TempStorage storage;
  AWAIT_LAUNCHES;
  long long own = 0;
  for (int k = 0; k < block_scan_items; ++k) {
    const int i = static_cast<int>(blockIdx.x) * scan_chunk + k * block_scan_threads + static_cast<int>(threadIdx.x);
    if (i < n) own += from[i];
  }
  own = Reduce(storage).Sum(own);
  if (threadIdx.x == 0) sum[blockIdx.x] = own;
}

/// Exclusive sums of a list of at most most_chunks chunks, after sum_chunks: two launches instead of five.
__global__ void __launch_bounds__(block_scan_threads)
    scan_chunks(int n, const int *from, const long long *sum, int *to, int *overflow)
{
  using Reduce = cub::BlockReduce<long long, block_scan_threads>;
  using Scan = cub::BlockScan<long long, block_scan_threads>;
  __shared__ union {
    typename Reduce::TempStorage reduce;
    typename Scan::TempStorage scan;
  } storage;
  __shared__ long long before;
  AWAIT_LAUNCHES;
  const long long all_before = Reduce(storage.reduce).Sum(threadIdx.x < blockIdx.x ? sum[threadIdx.x] : 0ll);
  if (threadIdx.x == 0) before = all_before;
  __syncthreads();
  long long value[block_scan_items], total;
  const int first = static_cast<int>(blockIdx.x) * scan_chunk + static_cast<int>(threadIdx.x) * block_scan_items;
  for (int k = 0; k < block_scan_items; ++k) value[k] = first + k < n ? from[first + k] : 0;
  Scan(storage.scan).ExclusiveSum(value, value, total);
  for (int k = 0; k < block_scan_items; ++k)
    if (first + k < n) to[first + k] = static_cast<int>(before + value[k]);
  if (threadIdx.x > 0 || blockIdx.x + 1 < gridDim.x) return;
  to[n] = static_cast<int>(before + total);
  if (before + total > 0x7fffffffll) *overflow = 1;
}

constexpr int block_sort_items = 8, longest_block_sort = 512 * block_sort_items;

/// Sorts at most threads * block_sort_items pairs by the lowest `bits` bits of their keys, equal keys in their order,
/// in one launch instead of several and two copies.
template <int threads>
__global__ void __launch_bounds__(threads) sort_by_block(int n, int bits, key64 *keys, int *values)
{
  using Load = cub::BlockLoad<key64, threads, block_sort_items, cub::BLOCK_LOAD_TRANSPOSE>;
  using LoadValues = cub::BlockLoad<int, threads, block_sort_items, cub::BLOCK_LOAD_TRANSPOSE>;
  using Sort = cub::BlockRadixSort<key64, threads, block_sort_items, int, threads < 512 ? 6 : 5>;
  __shared__ union {
    typename Load::TempStorage load;
    typename LoadValues::TempStorage load_values;
    typename Sort::TempStorage sort;
  } storage;
  key64 key[block_sort_items];
  int value[block_sort_items];
  AWAIT_LAUNCHES;
  Load(storage.load).Load(keys, key, n, ~key64(0));  // what is not there is last, and behind its equals
  __syncthreads();
  LoadValues(storage.load_values).Load(values, value, n, 0);
  __syncthreads();
  Sort(storage.sort).SortBlockedToStriped(key, value, 0, bits);
  cub::StoreDirectStriped<threads>(static_cast<int>(threadIdx.x), keys, key, n);
  cub::StoreDirectStriped<threads>(static_cast<int>(threadIdx.x), values, value, n);
}

// Short copies are kernels: they begin early, as other launches do.

__global__ void copy_words(int n, const int *from, int *to)
{
  FOR_EACH(i, n) to[i] = from[i];
}

__global__ void fill_words(int n, int word, int *to)
{
  FOR_EACH(i, n) to[i] = word;
}

/// One block. `number` behind the words says that they are there.
__global__ void answer_words(int n, const int *from, volatile int *to, volatile unsigned int *last_number,
                             unsigned int number)
{
  AWAIT_LAUNCHES;
  for (int i = static_cast<int>(threadIdx.x); i < n; i += static_cast<int>(blockDim.x)) to[i] = from[i];
  __threadfence_system();
  __syncthreads();
  if (threadIdx.x > 0) return;
  __threadfence_system();
  *last_number = number;
}

/// to[n] = total; a total beyond 2^31 raises the flag, which the next download reports.
__global__ void finish_scan(int n, const int *from, int *to, const long long *total, int *overflow)
{
  to[n] = to[n - 1] + from[n - 1];
  if (*total > 0x7fffffffll) *overflow = 1;
}

}  // namespace
}  // namespace cama
