/* SPDX-License-Identifier: Apache-2.0 */
/* What the items of a search find, kept between its two passes. */
#ifndef CAMA_KERNELS_COLLISION_HITS_H
#define CAMA_KERNELS_COLLISION_HITS_H
#include "../dialect/lang.h"
#include "tree.h"

/* Hits of a search. Every item has a row, hit[HIT_ROW item ..], for its first hits and the number of its last block.
   Further hits are in blocks, from hit[blocks_at] on, each of which ends with the number of the item's block before it.
   Blocks are taken from pools of pool_blocks each, by items in turn, so that few wait for the same counter, which is
   taken[POOL_STRIDE pool] and counts those for which there was no room too. */
#define HIT_ROW 16
#define HIT_BLOCK 32
#define MOST_POOLS 64
#define POOL_STRIDE 32
#define ROW_HITS (HIT_ROW - 1)
#define BLOCK_HITS (HIT_BLOCK - 1)
#define NO_BLOCK (-1)

/* Keeps hit number `found` of an item, whose last block is `block`; returns its last block afterwards, NO_BLOCK if it
   has none or there was no room. */
DEVICE_ATOMIC int keep_hit(int item, int found, int value, int block, int blocks_at, int pools, int pool_blocks,
                           GLOBAL int *hit, GLOBAL int *taken)
{
  int place = found - ROW_HITS;
  if (place < 0) {
    hit[HIT_ROW * item + found] = value;
    return NO_BLOCK;
  }
  if (place % BLOCK_HITS == 0) {
    int pool = (item >> 5) % pools, number = atomic_add_int(taken + POOL_STRIDE * pool, 1);
    if (number >= pool_blocks || (place > 0 && block == NO_BLOCK)) return NO_BLOCK;
    number += pool * pool_blocks;
    hit[blocks_at + HIT_BLOCK * number + BLOCK_HITS] = block;
    block = number;
  }
  if (block != NO_BLOCK) hit[blocks_at + HIT_BLOCK * block + place % BLOCK_HITS] = value;
  return block;
}

/* Hit number j of an item, where hits are asked for from the last one on; *block is its last block at first. */
DEVICE int kept_hit(int item, int j, int *block, int blocks_at, GLOBAL const int *hit)
{
  int place = j - ROW_HITS, value;
  if (place < 0) return hit[HIT_ROW * item + j];
  value = hit[blocks_at + HIT_BLOCK * *block + place % BLOCK_HITS];
  if (place % BLOCK_HITS == 0) *block = hit[blocks_at + HIT_BLOCK * *block + BLOCK_HITS];
  return value;
}

/* Hits that a team copies: of an item with more, whose chain of blocks is long, one work-item does. */
#define HIT_TEAM 256
#define COPIED_HITS 1024
DEVICE int hits_copied(int found, int block)
{
  return found <= ROW_HITS || (found <= COPIED_HITS && block != NO_BLOCK);
}

/* Hit number j of the `found` hits of an item, whose last block is `block`. */
DEVICE int hit_number(int item, int j, int found, int block, int blocks_at, GLOBAL const int *hit)
{
  const int place = j - ROW_HITS;
  int k;
  if (place < 0) return hit[HIT_ROW * item + j];
  for (k = (found - ROW_HITS - 1) / BLOCK_HITS; k > place / BLOCK_HITS; --k)
    block = hit[blocks_at + HIT_BLOCK * block + BLOCK_HITS];
  return hit[blocks_at + HIT_BLOCK * block + place % BLOCK_HITS];
}

/* Where GROUP items, from item `first` on, share a tree (take_share), the hits of each are leaves, in order. The leaves
   of all in order are what one item would have found. */
typedef struct {
  int left[GROUP], block[GROUP]; /* hits that come before, and the block of the last of them */
} shared_hits;

/* All hits of the shares; *kept = 0 if there was no room for some. */
DEVICE shared_hits hits_of_shares(int first, GLOBAL const int *hit, GLOBAL const int *count, int *kept)
{
  shared_hits h;
  *kept = 1;
  for (int k = 0; k < GROUP; ++k) {
    h.left[k] = count[first + k];
    h.block[k] = hit[HIT_ROW * (first + k) + ROW_HITS];
    *kept &= h.left[k] <= ROW_HITS || h.block[k] != NO_BLOCK;
  }
  return h;
}

/* The hits of all shares before `leaf`. Leaves are asked for from the last one on. */
DEVICE int hits_before(shared_hits *h, int first, int leaf, int blocks_at, GLOBAL const int *hit)
{
  int before = 0;
  for (int k = 0; k < GROUP; ++k) {
    while (h->left[k]) {
      int block = h->block[k];
      if (kept_hit(first + k, h->left[k] - 1, &block, blocks_at, hit) < leaf) break;
      h->block[k] = block;
      --h->left[k];
    }
    before += h->left[k];
  }
  return before;
}

#endif
