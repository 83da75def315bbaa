// SPDX-License-Identifier: Apache-2.0
// The OpenCL backend: planted errors are found and named, build errors too, the cache is safe.
#include <unistd.h>

#include <chrono>
#include <fstream>
#include <iterator>

#include "../backends.hpp"
#include "../catch.hpp"
#include "everything.hpp"
#include "launch.hpp"
#include "lockstep.hpp"
#if CAMA_HAS_OPENCL
#include "../../backends/opencl/program.hpp"
#endif

using namespace cama;
using namespace everything_scene;

namespace {

/// An environment variable for as long as this lives.
class Environment {
public:
  Environment(const char *name, const std::string &value) : name_(name)
  {
    if (const char *before = std::getenv(name)) before_ = before;
    setenv(name, value.c_str(), 1);
  }
  ~Environment()
  {
    if (before_) setenv(name_, before_->c_str(), 1);
    else unsetenv(name_);
  }

private:
  const char *name_;
  std::optional<std::string> before_;
};

/// A folder of its own, gone at the end.
struct Folder {
  std::filesystem::path path = std::filesystem::temp_directory_path() / ("cama_opencl_" + std::to_string(getpid()));
  Folder() { std::filesystem::remove_all(path); std::filesystem::create_directories(path); }
  ~Folder() { std::filesystem::remove_all(path); }
};

std::string read(const std::filesystem::path &path)
{
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

/// The kernels with one text replaced in one file.
void plant(const std::filesystem::path &folder, const std::string &file, const std::string &before, const std::string &after)
{
  std::filesystem::copy(std::filesystem::path(CAMA_SOURCE_DIR) / "libcama" / "kernels", folder, std::filesystem::copy_options::recursive);
  std::string text = read(folder / file);
  const std::size_t at = text.find(before);
  REQUIRE(at != std::string::npos);
  text.replace(at, before.size(), after);
  std::ofstream(folder / file, std::ios::binary) << text;
}

}  // namespace

TEST_CASE("lock step finds and names an error of 1e-15 planted in a kernel's text", "[lockstep][opencl]")
{
  if (!backend_here("opencl")) return;
  const Scene scene = everything(6);
  struct Plant { const char *file, *before, *after, *said; };
  for (const Plant &p : {Plant{"motion.h", "position_next[i] = daxpy(position[i], time_step, velocity_next[i]);",
                               "position_next[i] = dscale(1.0 + 1e-15, daxpy(position[i], time_step, velocity_next[i]));",
                               "stage advance positions, stream position_next, index "},
                         Plant{"solver.h", "  y[i] = sum;", "  y[i] = scale((real)(1.0 + 1e-15), sum);", "stage linear solve, stream "}}) {
    INFO(p.file);
    Folder folder;
    plant(folder.path, p.file, p.before, p.after);
    Environment kernels("CAMA_KERNELS", folder.path.string()), cache("CAMA_CACHE", "off");
    Engine reference(scene, with("double", 1)), candidate(scene, with("double", 0, Assembly::gather, "opencl"));
    const std::string text = lockstep::run(reference, candidate, 2);
    INFO(text);
    CHECK(contains(text, "step 1, "));
    CHECK(contains(text, p.said));
  }
}

TEST_CASE("a kernel that does not compile is named by file and line", "[opencl]")
{
  if (!backend_here("opencl")) return;
  Folder folder;
  plant(folder.path, "tree.h", "KERNEL tree_leaves(", "\n\nint wrong = no_such_name;\nKERNEL tree_leaves(");
  const std::string text_before = read(folder.path / "tree.h").substr(0, read(folder.path / "tree.h").find("int wrong"));
  const auto line = 1 + std::count(text_before.begin(), text_before.end(), '\n');
  Environment kernels("CAMA_KERNELS", folder.path.string()), cache("CAMA_CACHE", "off");
  const auto backend = make_backend("opencl");
  Stream<int> s(*backend, 10);
  const std::string text = thrown<BackendError>([&] { CAMA_LAUNCH(*backend, set_int, 10, 0, 7, s); });
  INFO(text);
  CHECK(contains(text, "tree.h:" + std::to_string(line)));
  CHECK(contains(text, "no_such_name"));
  CHECK(contains(text, "CL_BUILD_PROGRAM_FAILURE"));
}

#if CAMA_HAS_OPENCL
TEST_CASE("programs are kept on disk, and a bad file is ignored and replaced", "[opencl]")
{
  if (!backend_here("opencl")) return;
  Folder folder;
  Environment cache("CAMA_CACHE", folder.path.string());
  const auto build = [] {   // as a new process would
    opencl::Library library(opencl::choose_device(0));
    cl_int code;
    clReleaseKernel(clCreateKernel(library.program(opencl::Text::primitives), "scan_small", &code));
    REQUIRE(code == CL_SUCCESS);
  };
  const auto files = [&] {
    std::vector<std::filesystem::path> list;
    for (const auto &entry : std::filesystem::directory_iterator(folder.path / "opencl")) list.push_back(entry.path());
    return list;
  };
  build();
  REQUIRE(files().size() == 1);   // and no temporary file
  const std::filesystem::path file = files()[0];
  const std::string good = read(file);
  CHECK(good.size() > 1000);
  const auto long_ago = std::filesystem::last_write_time(file) - std::chrono::hours(1);
  std::filesystem::last_write_time(file, long_ago);
  build();
  CHECK(std::filesystem::last_write_time(file) == long_ago);   // read, not written
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
  Environment nowhere("CAMA_CACHE", "/proc/no/such/folder");   // cannot be written: no error
  build();
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

TEST_CASE("memory that cannot be had is named by the code, and what was there stays readable", "[opencl]")
{
  if (!backend_here("opencl")) return;
  const auto backend = make_backend("opencl");
  Stream<int> kept(*backend, std::vector<int>{1, 2, 3});
  const std::string text = thrown<MemoryError>([&] { backend->allocate(std::size_t(1) << 50); });
  CHECK(contains(text, "CL_"));
  CHECK(contains(text, std::to_string(std::size_t(1) << 50)));
  CHECK(kept.download() == std::vector<int>{1, 2, 3});
}
