// SPDX-License-Identifier: Apache-2.0
#include "launch_graphs.hpp"

#if CUDART_VERSION >= 12050
#include <cudaTypedefs.h>
#endif

#include <algorithm>
#include <utility>

#include "check.hpp"

namespace cama {
namespace {

constexpr int min_launches = 3;  // of a graph
constexpr int seen_before_graph = 3;  // how often a list returns before a graph is worth its making
constexpr std::size_t max_families = 4096;
constexpr int max_graphs = 512;

/// As a launch takes them: their addresses.
struct Arguments {
  Arguments(const LaunchList &list, const LaunchList::Launch &own)
  {
    for (int k = 0; k < own.count; ++k) address[k] = const_cast<Slot *>(list.slots.data() + own.first + k);
  }
  void *address[max_kernel_arguments + 1];
};

std::uint64_t hash_of(const LaunchList &list)
{
  std::uint64_t hash = fnv1a(nullptr, 0);
  for (const LaunchList::Launch &l : list.launches) {
    const bool early = l.early && &l != list.launches.data();  // the first node of a graph is behind none
    const Slot words[] = {to_slot(l.function), to_slot(l.shared), to_slot(early)};
    hash = fnv1a(words, sizeof words, hash);
  }
  return hash;
}

void launch(const LaunchList &list, int i, cudaStream_t stream)
{
  const LaunchList::Launch &own = list.launches[static_cast<std::size_t>(i)];
  Arguments arguments(list, own);
  cudaLaunchAttribute attribute;
  attribute.id = cudaLaunchAttributeProgrammaticStreamSerialization;
  attribute.val.programmaticStreamSerializationAllowed = 1;
  cudaLaunchConfig_t config{};
  config.gridDim = dim3(own.blocks);
  config.blockDim = dim3(own.threads);
  config.dynamicSmemBytes = own.shared;
  config.stream = stream;
  config.attrs = &attribute;
  config.numAttrs = own.early ? 1 : 0;
  check(cudaLaunchKernelExC(&config, own.function, arguments.address), own.name);
}

/// Sets what launch i of the list has instead. The driver's own function takes a quarter of the time of the runtime's.
void set_node(cudaGraphExec_t graph, cudaGraphNode_t node, const LaunchList &list, int i)
{
  const LaunchList::Launch &own = list.launches[static_cast<std::size_t>(i)];
  Arguments arguments(list, own);
#if CUDART_VERSION >= 12050
  static const auto set = [] {
    void *found = nullptr;
    cudaDriverEntryPointQueryResult result;
    check(cudaGetDriverEntryPointByVersion("cuGraphExecKernelNodeSetParams", &found, 12000, cudaEnableDefault, &result),
          "cudaGetDriverEntryPointByVersion");
    return reinterpret_cast<PFN_cuGraphExecKernelNodeSetParams_v12000>(found);
  }();
  cudaFunction_t function = nullptr;
  check(cudaGetFuncBySymbol(&function, own.function), own.name);
  CUDA_KERNEL_NODE_PARAMS parameters{};
  parameters.func = function;
  parameters.gridDimX = own.blocks;
  parameters.blockDimX = own.threads;
  parameters.gridDimY = parameters.gridDimZ = parameters.blockDimY = parameters.blockDimZ = 1;
  parameters.sharedMemBytes = own.shared;
  parameters.kernelParams = arguments.address;
  // The driver's numbers of errors are the runtime's.
  check(set ? static_cast<cudaError_t>(set(graph, node, &parameters)) : cudaErrorNotSupported, own.name);
#else
  cudaKernelNodeParams parameters{};
  parameters.func = const_cast<void *>(own.function);
  parameters.gridDim = dim3(own.blocks);
  parameters.blockDim = dim3(own.threads);
  parameters.sharedMemBytes = own.shared;
  parameters.kernelParams = arguments.address;
  check(cudaGraphExecKernelNodeSetParams(graph, node, &parameters), own.name);
#endif
}

/// The node that was recorded last.
cudaGraphNode_t last_node(cudaStream_t recorder)
{
  cudaStreamCaptureStatus status;
  unsigned long long id = 0;
  cudaGraph_t graph = nullptr;
  const cudaGraphNode_t *last = nullptr;
  std::size_t count = 0;
#if CUDART_VERSION >= 12030
  const cudaGraphEdgeData *edges = nullptr;
#endif
#if CUDART_VERSION >= 13000
  check(cudaStreamGetCaptureInfo(recorder, &status, &id, &graph, &last, &edges, &count), "cudaStreamGetCaptureInfo");
#elif CUDART_VERSION >= 12030
  check(cudaStreamGetCaptureInfo_v3(recorder, &status, &id, &graph, &last, &edges, &count), "cudaStreamGetCaptureInfo");
#else
  check(cudaStreamGetCaptureInfo_v2(recorder, &status, &id, &graph, &last, &count), "cudaStreamGetCaptureInfo");
#endif
  check(count == 1 ? cudaSuccess : cudaErrorStreamCaptureInvalidated, "cudaStreamGetCaptureInfo");
  return last[0];
}

}  // namespace

void LaunchList::clear()
{
  launches.clear();
  slots.clear();
}

bool LaunchList::like(const LaunchList &other) const
{
  return std::equal(launches.begin(), launches.end(), other.launches.begin(), other.launches.end(),
                    [this](const Launch &a, const Launch &b) {
                      return a.function == b.function && a.shared == b.shared &&
                             (a.early == b.early || &a == launches.data());
                    });
}

bool LaunchList::same_launch(const LaunchList &other, int i) const
{
  const Launch &a = launches[static_cast<std::size_t>(i)], &b = other.launches[static_cast<std::size_t>(i)];
  const auto from = slots.begin() + a.first;
  return a.blocks == b.blocks && a.threads == b.threads &&
         std::equal(from, from + a.count, other.slots.begin() + b.first);
}

LaunchGraphs::LaunchGraphs()
{
  check(cudaStreamCreateWithFlags(&recorder_, cudaStreamNonBlocking), "cudaStreamCreate");
}

LaunchGraphs::~LaunchGraphs()
{
  families_.clear();
  cudaStreamDestroy(recorder_);
}

LaunchGraphs::Graph::~Graph()
{
  if (executable) cudaGraphExecDestroy(executable);
  if (graph) cudaGraphDestroy(graph);
}

/// In a stream of its own: what runners of worlds ask of the queue in other threads meanwhile is not recorded.
std::unique_ptr<LaunchGraphs::Graph> LaunchGraphs::record(const LaunchList &list)
{
  auto made = std::make_unique<Graph>();
  check(cudaStreamBeginCapture(recorder_, cudaStreamCaptureModeThreadLocal), "cudaStreamBeginCapture");
  try {
    for (int i = 0; i < list.size(); ++i) {
      launch(list, i, recorder_);
      made->nodes.push_back(last_node(recorder_));
    }
  } catch (...) {
    cudaStreamEndCapture(recorder_, &made->graph);
    throw;
  }
  check(cudaStreamEndCapture(recorder_, &made->graph), "cudaStreamEndCapture");
  check(cudaGraphInstantiateWithFlags(&made->executable, made->graph, 0), "cudaGraphInstantiateWithFlags");
  made->list = list;
  return made;
}

/// Sets what has changed.
void LaunchGraphs::update(Graph &graph, const LaunchList &list)
{
  for (int i = 0; i < list.size(); ++i)
    if (!list.same_launch(graph.list, i)) set_node(graph.executable, graph.nodes[static_cast<std::size_t>(i)], list, i);
  graph.list = list;
}

/// Throws nothing, so that memory of the host that runs out costs a graph, not the launches: whoever asked for them has
/// gone on, and may count on them in the next step.
LaunchGraphs::Graph *LaunchGraphs::graph_for(const LaunchList &list, bool returns) noexcept
{
  if (list.size() < min_launches && !returns) return nullptr;
  if (families_.size() >= max_families || graphs_ >= max_graphs) {
    families_.clear();
    graphs_ = 0;
  }
  Family *family = nullptr;
  try {
    family = &families_[hash_of(list)];
    if (family->graph && !family->graph->list.like(list)) return nullptr;  // another list of this hash
    if (family->graph) {
      update(*family->graph, list);
    } else {
      if (++family->seen <= seen_before_graph && !returns) return nullptr;
      family->graph = record(list);
      ++graphs_;
    }
  } catch (...) {  // a lost device is reported by the launches
    if (!family) return nullptr;
    graphs_ -= family->graph ? 1 : 0;
    *family = {};
  }
  return family->graph.get();
}

void LaunchGraphs::run(const LaunchList &list, int times, bool returns, cudaStream_t stream)
{
  Graph *const graph = graph_for(list, returns);
  for (int t = 0; t < times; ++t) {
    if (graph)
      check(cudaGraphLaunch(graph->executable, stream), "cudaGraphLaunch");
    else
      for (int i = 0; i < list.size(); ++i) launch(list, i, stream);
  }
}

}  // namespace cama
