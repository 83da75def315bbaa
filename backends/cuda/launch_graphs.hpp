// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cuda_runtime.h>

#include <cstdint>
#include <memory>
#include <unordered_map>
#include <vector>

#include "device/for_backends.hpp"

namespace cama {

/// Launches in their order, with their arguments.
struct LaunchList {
  struct Launch {
    const void *function;
    const char *name;
    unsigned int blocks, threads;
    unsigned int shared;  // bytes of dynamic memory
    bool early;           // may begin while the one before ends (AWAIT_LAUNCHES in lang.h)
    int first, count;     // arguments
  };
  std::vector<Launch> launches;
  std::vector<Slot> slots;

  int size() const { return static_cast<int>(launches.size()); }
  void clear();
  /// The same kernels in the same order.
  bool like(const LaunchList &other) const;
  /// Whether launch i of a list like this one is the same here.
  bool same_launch(const LaunchList &other, int i) const;
};

/// Hands lists of launches to the device. Lists that return do so as graphs, whose nodes cost the host nothing, unless
/// their arguments have changed, and the device a fraction of a launch.
class LaunchGraphs {
public:
  LaunchGraphs();
  ~LaunchGraphs();
  LaunchGraphs(const LaunchGraphs &) = delete;
  LaunchGraphs &operator=(const LaunchGraphs &) = delete;

  /// Launches the list `times` times. returns: it is known to return, and becomes a graph at once.
  void run(const LaunchList &list, int times, bool returns, cudaStream_t stream);

private:
  struct Graph {
    ~Graph();
    LaunchList list;  // as it was launched last
    cudaGraph_t graph = nullptr;
    cudaGraphExec_t executable = nullptr;
    std::vector<cudaGraphNode_t> nodes;
  };
  /// Lists that are like each other.
  struct Family {
    std::unique_ptr<Graph> graph;
    int seen = 0;
  };

  /// As the list is; null where it is not worth a graph, or where none can be made.
  Graph *graph_for(const LaunchList &list, bool returns) noexcept;
  static void update(Graph &graph, const LaunchList &list);
  std::unique_ptr<Graph> record(const LaunchList &list);

  cudaStream_t recorder_ = nullptr;
  std::unordered_map<std::uint64_t, Family> families_;  // by the hash of their kernels
  int graphs_ = 0;
};

}  // namespace cama
