// SPDX-License-Identifier: Apache-2.0
// The OpenCL backend: planted errors and build errors are found and named, and the cache is safe.
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <fstream>
#include <iterator>

#include "../backends.hpp"
#include "../catch.hpp"
#include "device/launch.hpp"
#include "everything.hpp"
#include "lockstep.hpp"
#if CAMA_HAS_OPENCL
#include "backends/opencl/program.hpp"
#endif

using namespace cama;
using namespace everything_scene;

namespace {

/// Sets an environment variable while this object exists.
class Environment {
public:
  Environment(const char *name, const std::string &value) : name_(name)
  {
    if (const char *before = std::getenv(name)) before_ = before;
    setenv(name, value.c_str(), 1);
  }
  ~Environment()
  {
    if (before_)
      setenv(name_, before_->c_str(), 1);
    else
      unsetenv(name_);
  }

private:
  const char *name_;
  std::optional<std::string> before_;
};

/// A new folder, removed at the end.
struct Folder {
  std::filesystem::path path = std::filesystem::temp_directory_path() / ("cama_opencl_" + std::to_string(getpid()));
  Folder()
  {
    std::filesystem::remove_all(path);
    std::filesystem::create_directories(path);
  }
  ~Folder() { std::filesystem::remove_all(path); }
};

std::string read(const std::filesystem::path &path)
{
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

/// Replaces one text in one file of the kernels; further calls replace more.
void plant(const std::filesystem::path &folder, const std::string &file, const std::string &before,
           const std::string &after)
{
  std::filesystem::copy(std::filesystem::path(CAMA_SOURCE_DIR) / "libcama" / "kernels", folder,
                        std::filesystem::copy_options::recursive | std::filesystem::copy_options::skip_existing);
  std::string text = read(folder / file);
  const std::size_t at = text.find(before);
  REQUIRE(at != std::string::npos);
  text.replace(at, before.size(), after);
  std::ofstream(folder / file, std::ios::binary) << text;
}

}  // namespace

TEST_CASE("lock step finds and names an error of 1e-15 planted in a kernel's text", "[lockstep][opencl]")
{
  if (!lockstep::strict_build() || !backend_here("opencl")) return;
  // One error in a kernel of every stage that computes in two steps, the second one of BDF2; Newton's method runs those
  // of the stages before. Stages start from the reference's state, so that no error hides another.
  struct Plant {
    const char *file, *before, *after, *stage, *stream;
  };
  const std::vector<Plant> plants = {
      {"elements/motion.h", "base[i] = daxpy(now[i]", "base[i] = daxpy(dscale(1.0 + 1e-15, now[i])", "extrapolation",
       "position_base"},
      {"elements/motion.h", "daxpy(base[i], time_step, velocity[i])",
       "dscale(1.0 + 1e-15, daxpy(base[i], time_step, velocity[i]))", "prediction", "position_next"},
      {"elements/motion.h", "out[vertex[i]] = position[i];", "out[vertex[i]] = dscale(1.0 + 1e-15, position[i]);",
       "prescribed motion", "position_next"},
      {"elements/motion.h", "target[i] : daxpy(daxpy(position[i]",
       "target[i] : daxpy(daxpy(dscale(1.0 + 1e-15, position[i])", "candidate search", "predicted"},
      {"collision/contact.h", "    contacts[i] = c;", "    c.distance *= 1.0 + 1e-15;\n    contacts[i] = c;",
       "contacts", "contact"},
      {"elements/plate.h", "scale(-scales[h] * moment[h], gradient)",
       "scale(-(real)(1.0 + 1e-15) * scales[h] * moment[h], gradient)", "element forces", "hinge_force"},
      {"elements/plasticity.h", "plastic_next[i] = return_curvature(elastic,",
       "plastic_next[i] = return_curvature(dscale(1.0 + 1e-15, elastic),", "plastic bending", "plastic_curvature_next"},
      {"system/newton.h", ".push = step * (real)(c.stiffness * s.depth);",
       ".push = (real)(1.0 + 1e-15) * step * (real)(c.stiffness * s.depth);", "contact terms", "term"},
      {"system/abrupt.h", "t.push - (real)part;", "(real)(1.0 + 1e-15) * t.push - (real)part;", "abrupt contact",
       "term"},
      {"system/assembly.h", "mat3_diagonal(mass[-1 - source])",
       "mat3_diagonal((real)(1.0 + 1e-15) * mass[-1 - source])", "matrix assembly", "block"},
      {"solver/conjugate_gradient.h", "solution64[at] += (double)v.x;",
       "solution64[at] += (1.0 + 1e-15) * (double)v.x;", "linear solve", ""},
      {"elements/motion.h", "position_next[i] = daxpy(position[i], time_step, velocity_next[i]);",
       "position_next[i] = dscale(1.0 + 1e-15, daxpy(position[i], time_step, velocity_next[i]));", "advance positions",
       "position_next"},
      {"system/newton.h", "velocity[i] = daxpy(start[i], alpha, to_dvec3(direction[i]));",
       "velocity[i] = dscale(1.0 + 1e-15, daxpy(start[i], alpha, to_dvec3(direction[i])));", "newton iterations", ""},
      {"collision/commit.h", "committed[i] = t == 1.0 ? target[i]",
       "committed[i] = t == 1.0 ? dscale(1.0 + 1e-15, target[i])", "penetration handling", "position_next"}};
  Folder folder;
  for (const Plant &p : plants) plant(folder.path, p.file, p.before, p.after);
  Environment kernels("CAMA_KERNELS", folder.path.string()), cache("CAMA_CACHE", "off");
  const Scene scene = everything(6);
  Options one = with("double", 1), other = with("double", 0, Assembly::gather, "opencl");
  for (Options *options : {&one, &other}) {
    options->integrator = Integrator::bdf2;
    options->newton_iterations = 2;
  }
  StagedEngine reference(scene, one), candidate(scene, other);
  std::vector<std::string> found = lockstep::differences(reference, candidate, 2);
  for (const Plant &p : plants) {
    const std::string stage = ", stage " + std::string(p.stage) + ", stream ", said = stage + p.stream;
    INFO(said);
    const auto at =
        std::find_if(found.begin(), found.end(), [&](const std::string &text) { return contains(text, said); });
    REQUIRE(at != found.end());
    CHECK(contains(*at, ", index "));
    CHECK(contains(*at, ": values differ"));
    found.erase(
        std::remove_if(found.begin(), found.end(), [&](const std::string &text) { return contains(text, stage); }),
        found.end());
  }
  CHECK(found == std::vector<std::string>{});  // and nothing but what was planted
}

TEST_CASE("a kernel that does not compile is named by file and line", "[opencl]")
{
  if (!backend_here("opencl")) return;
  Folder folder;
  plant(folder.path, "collision/tree.h", "KERNEL tree_leaves(", "\n\nint wrong = no_such_name;\nKERNEL tree_leaves(");
  const std::string text_before =
      read(folder.path / "collision/tree.h").substr(0, read(folder.path / "collision/tree.h").find("int wrong"));
  const auto line = 1 + std::count(text_before.begin(), text_before.end(), '\n');
  Environment kernels("CAMA_KERNELS", folder.path.string()), cache("CAMA_CACHE", "off");
  const auto backend = make_backend("opencl");
  Stream<int> s(*backend, 10);
  const std::string text = thrown<BackendError>([&] { CAMA_LAUNCH(*backend, set_int, 10, 0, 7, s); });
  INFO(text);
  CHECK(contains(text, "collision/tree.h:" + std::to_string(line)));
  CHECK(contains(text, "no_such_name"));
  CHECK(contains(text, "CL_BUILD_PROGRAM_FAILURE"));
}

#if CAMA_HAS_OPENCL
TEST_CASE("programs are kept on disk, and a bad file is ignored and replaced", "[opencl]")
{
  if (!backend_here("opencl")) return;
  Folder folder;
  Environment cache("CAMA_CACHE", folder.path.string());
  const auto build = [] {  // as a new process would
    opencl::Library library(opencl::choose_device(0));
    cl_int code;
    opencl::api().clReleaseKernel(
        opencl::api().clCreateKernel(library.program(opencl::Text::primitives), "scan_small", &code));
    REQUIRE(code == CL_SUCCESS);
  };
  const auto files = [&] {
    std::vector<std::filesystem::path> list;
    for (const auto &entry : std::filesystem::directory_iterator(folder.path / "opencl")) list.push_back(entry.path());
    return list;
  };
  build();
  REQUIRE(files().size() == 1);  // and no temporary file
  const std::filesystem::path file = files()[0];
  const std::string good = read(file);
  CHECK(good.size() > 1000);
  const auto long_ago = std::filesystem::last_write_time(file) - std::chrono::hours(1);
  std::filesystem::last_write_time(file, long_ago);
  build();
  CHECK(std::filesystem::last_write_time(file) == long_ago);  // read, not written
  std::string flipped = good;
  flipped[good.size() / 2] = static_cast<char>(flipped[good.size() / 2] ^ 1);
  for (const std::string &bad : {std::string(), std::string("rubbish"), good.substr(0, good.size() / 2), flipped}) {
    std::ofstream(file, std::ios::binary) << bad;
    std::filesystem::last_write_time(file, long_ago);
    build();
    CHECK(std::filesystem::last_write_time(file) > long_ago);
    CHECK(read(file) != bad);
  }
  Environment off("CAMA_CACHE", "off");
  std::filesystem::remove_all(folder.path);
  build();
  CHECK_FALSE(std::filesystem::exists(folder.path));
  Environment nowhere("CAMA_CACHE", "/proc/no/such/folder");  // cannot be written: no error
  build();
}

TEST_CASE("builds the primitives into CAMA_CACHE", "[.][cache-writer]")  // for the test below, as a process of its own
{
  std::error_code gone;
  for (int i = 0; i < 20; ++i) {  // written again and again: a fresh library looks at the disk
    if (std::getenv("CAMA_CACHE_CLEAR"))
      for (const auto &entry :
           std::filesystem::directory_iterator(std::filesystem::path(std::getenv("CAMA_CACHE")) / "opencl", gone))
        if (entry.path().extension() == ".bin") std::filesystem::remove(entry.path(), gone);
    opencl::Library again(opencl::choose_device(0));
    cl_int code;
    opencl::api().clReleaseKernel(
        opencl::api().clCreateKernel(again.program(opencl::Text::primitives), "scan_small", &code));
    REQUIRE(code == CL_SUCCESS);
  }
}

TEST_CASE("processes that write the same program at once leave one whole file", "[opencl]")
{
  if (!backend_here("opencl")) return;
  Folder folder;
  Environment cache("CAMA_CACHE", folder.path.string());
  const std::string self = std::filesystem::read_symlink("/proc/self/exe").string();
  const std::string one = "\"" + self + "\" \"[cache-writer]\" > /dev/null";
  const std::string all = "CAMA_CACHE_CLEAR=1 " + one + " & a=$!; CAMA_CACHE_CLEAR=1 " + one + " & b=$!; " + one +
                          " & c=$!; wait $a && wait $b && wait $c";
  CHECK(std::system(all.c_str()) == 0);
  CHECK(std::system(one.c_str()) == 0);
  std::vector<std::filesystem::path> left;
  for (const auto &entry : std::filesystem::directory_iterator(folder.path / "opencl")) left.push_back(entry.path());
  REQUIRE(left.size() == 1);  // no temporary file
  CHECK(left[0].extension() == ".bin");
  const auto long_ago = std::filesystem::last_write_time(left[0]) - std::chrono::hours(1);
  std::filesystem::last_write_time(left[0], long_ago);
  CHECK(std::system(one.c_str()) == 0);
  CHECK(std::filesystem::last_write_time(left[0]) == long_ago);  // whole: it was read, not written again
}
#endif

TEST_CASE("devices are chosen by index or by part of a name", "[opencl]")
{
  Environment first("CAMA_OPENCL_DEVICE", "0");
  if (!backend_here("opencl")) return;
  std::vector<std::string> devices;
  for (const BackendInfo &info : list_backends())
    if (info.name == "opencl") devices = info.devices;
  REQUIRE(!devices.empty());
  CHECK(contains(make_backend("opencl")->device(), devices[0]));
  CHECK(contains(thrown<BackendError>([&] { make_backend("opencl", static_cast<int>(devices.size())); }), devices[0]));
  {
    std::string part = devices[0].substr(devices[0].size() / 2);
    Environment device("CAMA_OPENCL_DEVICE", part);
    CHECK(contains(make_backend("opencl")->device(), part));
  }
  {
    Environment first("CAMA_OPENCL_DEVICE", "0");
    CHECK(contains(make_backend("opencl")->device(), devices[0]));
  }
  Environment device("CAMA_OPENCL_DEVICE", "no such device");
  const std::string text = thrown<BackendError>([] { make_backend("opencl"); });
  CHECK(contains(text, "no such device"));
  CHECK(contains(text, devices[0]));
}

TEST_CASE("memory that cannot be allocated throws an error with the code, and earlier memory stays readable",
          "[opencl]")
{
  if (!backend_here("opencl")) return;
  const auto backend = make_backend("opencl");
  Stream<int> kept(*backend, std::vector<int>{1, 2, 3});
  const std::string text = thrown<MemoryError>([&] { backend->allocate(std::size_t(1) << 50); });
  CHECK(contains(text, "CL_"));
  CHECK(contains(text, std::to_string(std::size_t(1) << 50)));
  CHECK(kept.download() == std::vector<int>{1, 2, 3});
}
