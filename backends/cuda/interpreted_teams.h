/* SPDX-License-Identifier: Apache-2.0 */
/* Teams of kernels that the interpreter calls. Its blocks have more members than most teams: as many teams as fit work
   in a block at once, each with its share of the block's memory. */
#ifndef CAMA_CUDA_INTERPRETED_TEAMS_H
#define CAMA_CUDA_INTERPRETED_TEAMS_H

constexpr int interpreter_threads = 128;

/* Of the kernel that is called; set by the interpreter before each call. Sizes of teams are powers of two. Where the
   memory is not enough for all teams of a block, the members of the others wait. */
__shared__ int current_team_shift, current_teams;
__shared__ unsigned int used_memory[interpreter_threads / 32]; /* [warps] bytes that its team has taken */
extern __shared__ __align__(16) unsigned char all_team_memory[];

/* Bytes of all_team_memory: so few that eight blocks share a multiprocessor. The largest kernel takes nearly half of it
   in single precision, and nearly all in double. */
constexpr unsigned int team_memory_bytes = 22 * 1024;

static __device__ inline int team_size() { return 1 << current_team_shift; }
static __device__ inline int team_member() { return (int)threadIdx.x & (team_size() - 1); }
static __device__ inline int team_of_block() { return (int)threadIdx.x >> current_team_shift; }
static __device__ inline int first_team()
{
  return team_of_block() < current_teams ? (int)blockIdx.x * current_teams + team_of_block() : 0x7fffffff;
}
static __device__ inline int teams_at_once() { return (int)gridDim.x * current_teams; }

static __device__ inline void team_barrier()
{
  if (current_team_shift == 5)
    __syncwarp();
  else /* barrier 0 is that of the block */
    asm volatile("bar.sync %0, %1;" ::"r"(1 + team_of_block()), "r"(team_size()) : "memory");
}

template <class T> static __device__ inline T *team_memory(int count)
{
  const unsigned int warp = threadIdx.x / 32, at = *(volatile unsigned int *)&used_memory[warp];
  __syncwarp();
  if (threadIdx.x % 32 == 0)
    *(volatile unsigned int *)&used_memory[warp] = at + ((unsigned int)(count * sizeof(T)) + 15) / 16 * 16;
  __syncwarp();
  const unsigned int share = team_memory_bytes / current_teams / 16 * 16;
  if (team_of_block() >= current_teams) return nullptr;
  if (at + count * sizeof(T) > share) __trap();
  return (T *)(all_team_memory + team_of_block() * share + at);
}

#endif
