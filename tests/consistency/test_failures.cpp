// SPDX-License-Identifier: Apache-2.0
// Failures are clean: memory of the device and of the host that runs out at any allocation, devices that are lost,
// drivers and features that are missing. The linker replaces f by __wrap_f in this program only (--wrap); OpenCL's
// functions are replaced where the backend looks them up, by dlsym.
#include <algorithm>
#include <atomic>
#include <cstddef>
#include <cstdlib>
#include <cstring>
#include <functional>
#include <new>
#include <numeric>
#include <random>

#include "../backends.hpp"
#include "../stable_sort.hpp"
#include "device/launch.hpp"
#include "everything.hpp"
#include "lockstep.hpp"
#if CAMA_HAS_OPENCL
#include "backends/opencl/program.hpp"
#endif

namespace fault {

/// The number of calls before the one that fails; below 0: none fails.
using Countdown = std::atomic<long>;
Countdown device_memory{-1}, host_memory{-1}, graphs{-1}, launches{-1};

thread_local bool recording = false;  // launches into a graph
long refused_graphs = 0;

bool due(Countdown &countdown) { return countdown >= 0 && countdown-- == 0; }

}  // namespace fault

extern "C" {
void *__real_aligned_alloc(std::size_t, std::size_t);
void *__wrap_aligned_alloc(std::size_t alignment, std::size_t bytes)
{
  return fault::due(fault::device_memory) ? nullptr : __real_aligned_alloc(alignment, bytes);
}
void *__real__Znwm(std::size_t);
void *__wrap__Znwm(std::size_t bytes)   // operator new
{
  if (fault::due(fault::host_memory)) throw std::bad_alloc();
  return __real__Znwm(bytes);
}
#if CAMA_HAS_CUDA
int __real_cudaMalloc(void **, std::size_t);
int __wrap_cudaMalloc(void **memory, std::size_t bytes)
{
  return fault::due(fault::device_memory) ? 2 : __real_cudaMalloc(memory, bytes);
}
int __real_cudaMallocAsync(void **, std::size_t, void *);
int __wrap_cudaMallocAsync(void **memory, std::size_t bytes, void *queue)
{
  return fault::due(fault::device_memory) ? 2 : __real_cudaMallocAsync(memory, bytes, queue);
}
int __real_cudaGraphInstantiateWithFlags(void **, void *, unsigned long long);
int __wrap_cudaGraphInstantiateWithFlags(void **executable, void *graph, unsigned long long flags)
{
  return fault::due(fault::graphs) ? 2 : __real_cudaGraphInstantiateWithFlags(executable, graph, flags);
}
int __real_cudaStreamBeginCapture(void *, int);
int __wrap_cudaStreamBeginCapture(void *queue, int mode)
{
  fault::recording = true;
  return __real_cudaStreamBeginCapture(queue, mode);
}
int __real_cudaStreamEndCapture(void *, void **);
int __wrap_cudaStreamEndCapture(void *queue, void **graph)
{
  fault::recording = false;
  return __real_cudaStreamEndCapture(queue, graph);
}
int __real_cudaGraphLaunch(void *, void *);
int __wrap_cudaGraphLaunch(void *graph, void *queue)
{
  if (!fault::due(fault::launches)) return __real_cudaGraphLaunch(graph, queue);
  ++fault::refused_graphs;
  return 2;
}
int __real_cudaLaunchKernelExC(const void *, const void *, void **);
int __wrap_cudaLaunchKernelExC(const void *config, const void *kernel, void **arguments)
{
  return !fault::recording && fault::due(fault::launches) ? 2 : __real_cudaLaunchKernelExC(config, kernel, arguments);
}
#endif
}

#if CAMA_HAS_OPENCL
namespace fault {

bool no_platform = false, no_double = false, as_gpu = false;
std::size_t max_work_items = 0;       // of any kernel; 0: the driver's own
std::string lost_call;                 // this call fails
cl_int lost_code = CL_SUCCESS;
long contexts = 0, buffers = 0;        // contexts made; buffers alive

bool lost(const char *call) { return lost_call == call; }

}  // namespace fault

/// What stands between the backend and the loader's functions, `real`.
namespace faulty {

cama::opencl::Api real;

cl_int clGetPlatformIDs(cl_uint n, cl_platform_id *ids, cl_uint *count)
{
  return fault::no_platform ? -1001 : real.clGetPlatformIDs(n, ids, count);
}
cl_int clGetDeviceInfo(cl_device_id id, cl_device_info what, size_t size, void *value, size_t *needed)
{
  const cl_int code = real.clGetDeviceInfo(id, what, size, value, needed);
  if (value && what == CL_DEVICE_DOUBLE_FP_CONFIG && fault::no_double) *static_cast<cl_device_fp_config *>(value) = 0;
  if (value && what == CL_DEVICE_TYPE && fault::as_gpu) *static_cast<cl_device_type *>(value) = CL_DEVICE_TYPE_GPU;
  return code;
}
cl_int clGetKernelWorkGroupInfo(cl_kernel kernel, cl_device_id id, cl_kernel_work_group_info what, size_t size,
                                void *value, size_t *needed)
{
  const cl_int code = real.clGetKernelWorkGroupInfo(kernel, id, what, size, value, needed);
  if (value && what == CL_KERNEL_WORK_GROUP_SIZE && fault::max_work_items)
    *static_cast<size_t *>(value) = fault::max_work_items;
  return code;
}
cl_context clCreateContext(const cl_context_properties *properties, cl_uint n, const cl_device_id *ids,
                           void (*notify)(const char *, const void *, size_t, void *), void *user, cl_int *code)
{
  ++fault::contexts;
  return real.clCreateContext(properties, n, ids, notify, user, code);
}
cl_mem clCreateBuffer(cl_context context, cl_mem_flags flags, size_t bytes, void *host, cl_int *code)
{
  if (fault::due(fault::device_memory)) {
    *code = CL_MEM_OBJECT_ALLOCATION_FAILURE;
    return nullptr;
  }
  cl_mem buffer = real.clCreateBuffer(context, flags, bytes, host, code);
  fault::buffers += buffer != nullptr;
  return buffer;
}
cl_int clReleaseMemObject(cl_mem buffer)
{
  --fault::buffers;
  return real.clReleaseMemObject(buffer);
}
cl_int clEnqueueNDRangeKernel(cl_command_queue queue, cl_kernel kernel, cl_uint dimensions, const size_t *offset,
                              const size_t *global, const size_t *local, cl_uint n, const cl_event *wait,
                              cl_event *event)
{
  if (fault::lost("clEnqueueNDRangeKernel")) return fault::lost_code;
  if (fault::max_work_items && local && *local > fault::max_work_items) return CL_INVALID_WORK_GROUP_SIZE;
  return real.clEnqueueNDRangeKernel(queue, kernel, dimensions, offset, global, local, n, wait, event);
}
cl_int clEnqueueReadBuffer(cl_command_queue queue, cl_mem buffer, cl_bool block, size_t offset, size_t bytes, void *to,
                           cl_uint n, const cl_event *wait, cl_event *event)
{
  if (fault::lost("clEnqueueReadBuffer")) return fault::lost_code;
  return real.clEnqueueReadBuffer(queue, buffer, block, offset, bytes, to, n, wait, event);
}
cl_int clEnqueueWriteBuffer(cl_command_queue queue, cl_mem buffer, cl_bool block, size_t offset, size_t bytes,
                            const void *from, cl_uint n, const cl_event *wait, cl_event *event)
{
  if (fault::lost("clEnqueueWriteBuffer")) return fault::lost_code;
  return real.clEnqueueWriteBuffer(queue, buffer, block, offset, bytes, from, n, wait, event);
}
cl_int clFinish(cl_command_queue queue)
{
  if (fault::lost("clFinish")) return fault::lost_code;
  return real.clFinish(queue);
}
}  // namespace faulty

extern "C" {
void *__real_dlsym(void *, const char *);
void *__wrap_dlsym(void *library, const char *name)
{
  void *found = __real_dlsym(library, name);
  const auto replaced = [&](const char *function, auto &real, auto *replacement) {
    if (!found || std::strcmp(name, function) != 0) return;
    real = reinterpret_cast<decltype(replacement)>(found);
    found = reinterpret_cast<void *>(replacement);
  };
#define CAMA_FAULTY(name) replaced(#name, faulty::real.name, &faulty::name)
  CAMA_FAULTY(clGetPlatformIDs);
  CAMA_FAULTY(clGetDeviceInfo);
  CAMA_FAULTY(clGetKernelWorkGroupInfo);
  CAMA_FAULTY(clCreateContext);
  CAMA_FAULTY(clCreateBuffer);
  CAMA_FAULTY(clReleaseMemObject);
  CAMA_FAULTY(clEnqueueNDRangeKernel);
  CAMA_FAULTY(clEnqueueReadBuffer);
  CAMA_FAULTY(clEnqueueWriteBuffer);
  CAMA_FAULTY(clFinish);
#undef CAMA_FAULTY
  return found;
}
}
#endif

using namespace cama;
using namespace everything_scene;

namespace {

/// Everything a user can read after a step.
struct Seen {
  int step, contacts, iterations, exempt;
  double time;
  std::uint64_t hash;
  std::vector<dvec3> position, velocity, plastic_curvature;
};

Seen look(const Simulation &s)
{
  const StepReport &r = s.report();
  return {s.step_count(), r.contacts,     r.iterations,         r.exempt, s.time(), s.state_hash(),
          s.positions(),  s.velocities(), s.plastic_curvature()};
}

bool same(const std::vector<dvec3> &a, const std::vector<dvec3> &b)
{
  return a.size() == b.size() && std::equal(a.begin(), a.end(), b.begin(), [](const dvec3 &p, const dvec3 &q) {
           return p.x == q.x && p.y == q.y && p.z == q.z;
         });
}

bool same(const Seen &a, const Seen &b)
{
  return a.step == b.step && a.contacts == b.contacts && a.iterations == b.iterations && a.exempt == b.exempt &&
         a.time == b.time && a.hash == b.hash && same(a.position, b.position) && same(a.velocity, b.velocity) &&
         same(a.plastic_curvature, b.plastic_curvature);
}

/// middle: the step at which a run is disturbed.
struct Case {
  const char *name;
  Scene scene;
  Options options;
  int middle;
};

/// A strip that sticks in a sheet and leaves it upwards within a few steps.
Scene tangle()
{
  Scene s;
  s.time_step = 1.0 / 200;
  s.contact.thickness = 4e-3;
  s.cloths.push_back(meshes::cloth(meshes::grid(4, 4, 0.2, 0.2, -0.101, -0.103)));
  Mesh strip = meshes::grid(2, 3, 0.06, 0.09, -0.03, 0);
  for (dvec3 &x : strip.position) x = {x.x, 0.004, x.y - 0.011};
  s.cloths.push_back(meshes::cloth(strip, meshes::cotton(), "strip"));
  s.cloths[1].velocity = {0, 0, 2};
  return s;
}

/// Two boxes that close on a sheet, which is released at about step 39.
Scene pinched()
{
  Scene s;
  s.gravity = {0, 0, 0};
  s.time_step = 0.02;
  s.contact.thickness = 2e-3;
  s.cloths.push_back(meshes::cloth(meshes::grid(4, 4, 0.2, 0.2, -0.1, -0.1, 0)));
  for (double side : {-1.0, 1.0}) {
    Obstacle box = exact_box({0.003, 0.002, 0.09 * side}, {0.15, 0.14, 0.1});
    box.name = side < 0 ? "lower" : "upper";
    box.motion.velocity = {0, 0, -0.05 * side};
    s.obstacles.push_back(box);
  }
  Pin hold;
  hold.vertices = {0, 4, 20, 24};
  hold.release = 0.85;
  s.pins.push_back(hold);
  return s;
}

/// Pins that end: one that follows the ball, one by itself.
Scene released()
{
  Scene s = everything(4);
  Pin follows;
  follows.vertices = {20, 24};
  follows.obstacle = 0;
  follows.release = s.pins[0].release = 2.5 * s.time_step;
  s.pins.push_back(follows);
  return s;
}

/// Cases that keep different data between steps.
std::vector<Case> cases(const std::string &backend)
{
  std::vector<Case> list;
  const auto add = [&](const char *name, Scene scene, Options o, int middle = 0) {
    o.backend = backend;
    o.threads = backend == "cpu" ? 2 : 0;
    list.push_back({name, std::move(scene), o, middle});
  };
  Options production, paper = Options::at(Accuracy::paper), sorted, exempt, release;
  sorted.paper.assembly = Assembly::sorted;
  sorted.precision = Precision::single;
  exempt.intersections = StartPolicy::exempt;
  exempt.audit = true;
  release.pinch = Pinch::release;
  add("production", everything(4), production);
  add("paper", everything_of_paper(4), paper);
  add("sorted, single", everything(4), sorted);
  add("released pins", released(), production);
  add("tangled start", tangle(), exempt);
  add("pinch", pinched(), release, 36);
  add("accurate", everything(3), Options::at(Accuracy::accurate));
  return list;
}

/// Takes a step in which allocation `first` fails, then that `stride` later, and so on until none fails. After each
/// failure the state is the previous one and can be read completely. may_do_without: what fails may be something that
/// the step can do without, such as a graph; then it ends there. Returns the number of failures.
int step_through_failures(Simulation &s, fault::Countdown &countdown, int first, int stride,
                          bool may_do_without = false)
{
  const Seen before = look(s);
  for (int failures = 0, k = first;; ++failures, k += stride) {
    countdown = k;
    try {
      s.step();
    } catch (const MemoryError &) {
      countdown = -1;
      REQUIRE(same(look(s), before));
      s.energy();
      s.max_strain();
      s.contacts();
      s.min_gap();
      continue;
    } catch (const std::exception &e) {
      countdown = -1;
      FAIL("not a MemoryError at allocation " << k << ": " << e.what());
    }
    const bool failed_in_silence = countdown < 0;
    countdown = -1;
    REQUIRE((may_do_without || !failed_in_silence));
    return failures;
  }
}

std::vector<std::uint64_t> undisturbed(const Case &c, int steps)
{
  Simulation s(c.scene, c.options);
  std::vector<std::uint64_t> hashes{s.state_hash()};
  for (int i = 0; i < steps; ++i) {
    s.step();
    hashes.push_back(s.state_hash());
  }
  return hashes;
}

/// Every stride-th allocation of the first step fails: the start stays, and a later step gives the same bits.
void fail_first_steps(int stride)
{
  for (const std::string &backend : backends_here())
    for (const Case &c : cases(backend)) {
      INFO(backend << ", " << c.name);
      if (backend != "cpu" && c.options.accuracy == Accuracy::production && std::string(c.name) != "production")
        continue;   // the same allocations
      const std::vector<std::uint64_t> expected = undisturbed(c, 2);
      int failures = 0;
      for (bool failed = true; failed; failures += failed) {
        INFO("allocation " << failures * stride);
        Simulation s(c.scene, c.options);
        fault::device_memory = failures * stride;
        try {
          s.step();
          failed = false;
        } catch (const MemoryError &e) {
          CHECK(std::string(e.what()).size() > 40);
        }
        fault::device_memory = -1;
        REQUIRE(s.state_hash() == expected[failed ? 0 : 1]);
        while (s.step_count() < 2) s.step();
        REQUIRE(s.state_hash() == expected[2]);
      }
      CHECK(failures > (stride == 1 ? 10 : 3));
    }
}

/// Every stride-th allocation of steps in the middle of a run fails, another one in the next step.
void fail_later_steps(int stride)
{
  for (const std::string &backend : backends_here())
    for (const Case &c : cases(backend)) {
      INFO(backend << ", " << c.name);
      const std::vector<std::uint64_t> expected = undisturbed(c, c.middle + 10);
      Simulation s(c.scene, c.options);
      int failures = 0;
      while (s.step_count() < c.middle) s.step();
      for (int i = c.middle + 1; i <= c.middle + 10; ++i) {
        failures += step_through_failures(s, fault::device_memory, i % stride, stride);
        REQUIRE(s.state_hash() == expected[static_cast<std::size_t>(i)]);
      }
      CHECK(failures > (stride == 1 ? 10 : 3));
    }
}

/// The same for memory of the host.
void fail_host_memory(const std::string &backend, int stride)
{
  for (const Case &c : cases(backend)) {
    INFO(backend << ", " << c.name);
    const std::vector<std::uint64_t> expected = undisturbed(c, c.middle + 8);
    Simulation s(c.scene, c.options);
    int failures = 0;
    while (s.step_count() < c.middle) s.step();
    for (int i = c.middle + 1; i <= c.middle + 8; ++i) {
      failures += step_through_failures(s, fault::host_memory, i % stride, stride, backend == "cuda");
      REQUIRE(s.state_hash() == expected[static_cast<std::size_t>(i)]);
    }
    CHECK(failures > (stride == 1 ? 10 : 3));
  }
}

constexpr int sparse = 11;  // of the allocations, one fails; in the long tests each of them

}  // namespace

TEST_CASE("device memory that runs out in the first step: the start stays, a later step gives the same bits",
          "[failures]")
{
  fail_first_steps(sparse);
}
TEST_CASE("device memory that runs out again and again in the middle of a run: the same bits in the end", "[failures]")
{
  fail_later_steps(sparse);
}
TEST_CASE("host memory that runs out again and again in the middle of a run: the same bits in the end", "[failures]")
{
  for (const std::string &backend : backends_here()) fail_host_memory(backend, backend == "cpu" ? sparse : 7 * sparse);
}
TEST_CASE("memory that runs out at any allocation: the same bits in the end", "[failures][.][long]")
{
  fail_first_steps(1);
  fail_later_steps(1);
  for (const std::string &backend : backends_here()) fail_host_memory(backend, backend == "cpu" ? 1 : sparse);
}

#if CAMA_HAS_CUDA
TEST_CASE("a graph that cannot be made: its launches follow one by one, with the same bits", "[failures][cuda]")
{
  if (!backend_here("cuda")) return;
  const Case c = cases("cuda").front();
  const int steps = 12;
  const std::vector<std::uint64_t> expected = undisturbed(c, steps);
  int refused = 0;
  for (bool missing = true; missing; refused += missing) {
    INFO("graph " << 5 * refused);
    Simulation s(c.scene, c.options);
    fault::graphs = 5 * refused;
    while (s.step_count() < steps) s.step();
    missing = fault::graphs < 0;
    fault::graphs = -1;
    REQUIRE(s.state_hash() == expected[steps]);
  }
  CHECK(refused > 3);
}

TEST_CASE("a launch that is refused is an error of its step, which can be taken again with the same bits",
          "[failures][cuda]")
{
  if (!backend_here("cuda")) return;
  const Case c = cases("cuda").front();
  const int steps = 8;   // the last ones with graphs
  const std::vector<std::uint64_t> expected = undisturbed(c, steps);
  Simulation s(c.scene, c.options);
  int failures = 0;
  for (int i = 1; i <= steps; ++i) {
    const int of_step = step_through_failures(s, fault::launches, i % sparse, sparse);
    CHECK(of_step > 4);
    failures += of_step;
    REQUIRE(s.state_hash() == expected[static_cast<std::size_t>(i)]);
  }
  CHECK(failures > 5 * steps);
  CHECK(fault::refused_graphs > 0);
}
#endif

TEST_CASE("memory that runs out while a simulation is made is a MemoryError, and nothing leaks", "[failures]")
{
  const auto count = [](const Case &c, fault::Countdown &countdown, int stride) {
    for (int k = 0;; k += stride) {
#if CAMA_HAS_OPENCL
      const long buffers = fault::buffers;
#endif
      countdown = k;
      try {
        const Simulation s(c.scene, c.options);
        countdown = -1;
        return k;
      } catch (const MemoryError &e) {
        countdown = -1;
      }
#if CAMA_HAS_OPENCL
      REQUIRE(fault::buffers == buffers);
#endif
    }
  };
  for (const std::string &backend : backends_here())
    for (const Case &c : cases(backend)) {
      INFO(backend << ", " << c.name);
      CHECK(count(c, fault::device_memory, 3) > 20);
      if (backend == "cpu") CHECK(count(c, fault::host_memory, 23) > 100);
    }
}

TEST_CASE("out of memory: what was asked for, what was there and what to do", "[failures]")
{
  for (const std::string &name : backends_here()) {
    INFO(name);
    const auto backend = make_backend(name);
    Stream<int> kept(*backend, std::vector<int>{1, 2, 3});
    fault::device_memory = 0;
    const std::string text = thrown<MemoryError>([&] { Stream<double> s(*backend, 1000); });
    INFO(text);
    CHECK(contains(text, "8000"));
    CHECK(contains(text, "lower the resolution"));
    if (name == "opencl") CHECK(contains(text, "clCreateBuffer"));
    if (name == "opencl") CHECK(contains(text, "CL_MEM_OBJECT_ALLOCATION_FAILURE (-4)"));
    if (name == "cuda") CHECK(contains(text, "cudaErrorMemoryAllocation"));
    CHECK(kept.download() == std::vector<int>{1, 2, 3});
    CHECK(backend->allocated_bytes() == 12);
  }
}

#if CAMA_HAS_OPENCL
TEST_CASE("a lost device is a BackendError with the driver's code; a new simulation opens it anew",
          "[failures][opencl]")
{
  if (!backend_here("opencl")) return;
  const Scene scene = everything(4);
  const Options o = with("double", 0, Assembly::gather, "opencl");
  Simulation whole(scene, o);
  whole.step();
  struct Loss {
    const char *call;
    cl_int code;
    const char *name;
  };
  for (const Loss &loss : {Loss{"clEnqueueNDRangeKernel", CL_DEVICE_NOT_AVAILABLE, "CL_DEVICE_NOT_AVAILABLE (-2)"},
                           Loss{"clEnqueueNDRangeKernel", CL_OUT_OF_RESOURCES, "CL_OUT_OF_RESOURCES (-5)"},
                           Loss{"clEnqueueReadBuffer", CL_OUT_OF_RESOURCES, "CL_OUT_OF_RESOURCES (-5)"},
                           Loss{"clEnqueueReadBuffer", CL_INVALID_COMMAND_QUEUE, "CL_INVALID_COMMAND_QUEUE (-36)"},
                           Loss{"clEnqueueWriteBuffer", CL_DEVICE_NOT_AVAILABLE, "CL_DEVICE_NOT_AVAILABLE (-2)"}}) {
    INFO(loss.call << " " << loss.name);
    const long contexts = fault::contexts;
    {
      Simulation s(scene, o);
      fault::lost_call = loss.call;
      fault::lost_code = loss.code;
      const std::string text = thrown<BackendError>([&] { s.step(); });
      fault::lost_call.clear();
      INFO(text);
      CHECK(contains(text, loss.call));
      CHECK(contains(text, loss.name));
      CHECK(contains(text, "; "));   // and what to do
      CHECK(s.step_count() == 0);
    }
    Simulation again(scene, o);
    CHECK(fault::contexts == contexts + 1);
    again.step();
    CHECK(again.state_hash() == whole.state_hash());
  }
  const auto backend = make_backend("opencl");
  fault::lost_call = "clFinish";
  fault::lost_code = CL_DEVICE_NOT_AVAILABLE;
  const std::string text = thrown<BackendError>([&] { backend->synchronize(); });
  fault::lost_call.clear();
  CHECK(contains(text, "clFinish"));
  CHECK(contains(text, "CL_DEVICE_NOT_AVAILABLE (-2); the device may be lost; make a new simulation"));
}

TEST_CASE("no driver: the backend is listed as absent, and choosing it says what to install", "[failures][opencl]")
{
  fault::no_platform = true;
  const std::string text = thrown<BackendError>([] { make_backend("opencl"); });
  std::string note;
  bool available = true;
  for (const BackendInfo &info : list_backends())
    if (info.name == "opencl") {
      note = info.note;
      available = info.available;
    }
  fault::no_platform = false;
  CHECK(contains(text, "install a driver"));
  CHECK_FALSE(available);
  CHECK(contains(note, "pocl"));
}

TEST_CASE("a device without double precision is rejected with its name", "[failures][opencl]")
{
  if (!backend_here("opencl")) return;
  const std::string name = opencl::choose_device(0).name;
  fault::no_double = true;
  const std::string text = thrown<BackendError>([] { make_backend("opencl"); });
  std::string note;
  for (const BackendInfo &info : list_backends())
    if (info.name == "opencl") note = info.note;
  fault::no_double = false;
  for (const std::string &said : {text, note}) {
    INFO(said);
    CHECK(contains(said, "device '" + name + "' lacks double precision (cl_khr_fp64)"));
  }
}

namespace {

/// limits: limits of the work-group; 0: the driver's own.
void check_as_gpu(std::initializer_list<std::size_t> limits)
{
  if (!lockstep::strict_build() || !backend_here("opencl")) return;
  const opencl::Device device = opencl::choose_device(0);
  const Scene scene = everything(4);
  const std::uint64_t expected = simulate(scene, with("double", 1), 2).hash;
  fault::as_gpu = true;
  for (std::size_t most : limits) {
    INFO("work-groups of at most " << most);
    fault::max_work_items = most;
    opencl::Library::of(device).lose();
    CHECK_FALSE(opencl::Library::of(device).is_cpu);
    CHECK(simulate(scene, with("double", 0, Assembly::gather, "opencl"), 2).hash == expected);
    const auto backend = make_backend("opencl");
    std::mt19937_64 random(5);
    for (const int n : {0, 1, 4096, 8192, 8193, 40000}) {
      std::vector<int> values(static_cast<std::size_t>(n)), sums(values.size() + 1, 0);
      for (int &v : values) v = static_cast<int>(random() % 100);
      std::partial_sum(values.begin(), values.end(), sums.begin() + 1);
      Stream<int> from(*backend, values), to(*backend, n + 1);
      backend->scan(from.buffer(), to.buffer(), n);
      CHECK(to.download() == sums);
      values.assign(values.size(), 0x7fffffff);
      from.assign(values);
      backend->scan(from.buffer(), to.buffer(), n);
      if (n > 1) CHECK_THROWS_AS(to.at(0), MemoryError);
    }
    for (const int bits : {11, 30, 43, 63, 64})
      for (const int n : {2, 16, 49, 2049, 7000}) {
        std::vector<key64> keys(static_cast<std::size_t>(n));
        for (key64 &k : keys) k = random() >> (64 - bits) & ~key64(0x70);   // some are equal
        INFO(n << " keys of " << bits << " bits");
        CHECK(sorts_stably(*backend, keys, bits));
      }
  }
  fault::as_gpu = false;
  fault::max_work_items = 0;
  opencl::Library::of(device).lose();
}

}  // namespace

TEST_CASE("launched as on a GPU with small work-groups, the bits are the same", "[failures][opencl]")
{
  check_as_gpu({3});
}
TEST_CASE("launched as on a GPU, at any limit of the work-group, the bits are the same", "[failures][opencl][.][long]")
{
  check_as_gpu({0, 1, 96});
}
#endif
