/* SPDX-License-Identifier: Apache-2.0 */
/* Teams of kernels that the interpreter calls. Its blocks have more members than most teams: as many teams as fit work
   in a block at once, each with its share of the block's memory. */
#ifndef CAMA_CUDA_INTERPRETED_TEAMS_H
#define CAMA_CUDA_INTERPRETED_TEAMS_H

constexpr int interpreter_threads = 256;

/* Of the kernel that is called; each warp sets its own before each call. Sizes of teams are powers of two. */
__shared__ int team_shifts[interpreter_threads / 32];          /* logarithm of the members of a team */
__shared__ unsigned int used_memory[interpreter_threads / 32]; /* bytes that the team has taken */
extern __shared__ __align__(16) unsigned char all_team_memory[];

static __device__ inline int team_shift() { return team_shifts[threadIdx.x / 32]; }
static __device__ inline int team_size() { return 1 << team_shift(); }
static __device__ inline int team_member() { return (int)threadIdx.x & (team_size() - 1); }
static __device__ inline int team_of_block() { return (int)threadIdx.x >> team_shift(); }
static __device__ inline int teams_of_block() { return interpreter_threads >> team_shift(); }
static __device__ inline int first_team() { return (int)blockIdx.x * teams_of_block() + team_of_block(); }
static __device__ inline int teams_at_once() { return (int)gridDim.x * teams_of_block(); }

static __device__ inline void team_barrier()
{
  if (team_shift() == 5)
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
  unsigned int bytes;
  asm("mov.u32 %0, %%dynamic_smem_size;" : "=r"(bytes));
  const unsigned int share = bytes / teams_of_block() / 16 * 16;
  if (at + count * sizeof(T) > share) __trap();
  return (T *)(all_team_memory + team_of_block() * share + at);
}

#endif
