// SPDX-License-Identifier: Apache-2.0
#include "program.hpp"

#include <unistd.h>

#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <regex>
#include <set>
#include <sstream>
#include <utility>
#include <vector>

#include "cama/error.hpp"
#include "device/for_backends.hpp"

namespace cama::opencl {
namespace {

namespace fs = std::filesystem;

std::string read_file(const fs::path &path)
{
  std::ifstream file(path, std::ios::binary);
  std::ostringstream text;
  text << file.rdbuf();
  return file ? text.str() : "";
}

/// The text of a kernel header ("collision/tree.h") or of "primitives.cl".
std::string kernel_text(const std::string &file)
{
  if (file == "primitives.cl") return embedded_primitives[0].text;
  const char *folder = std::getenv("CAMA_KERNELS");
  if (folder && *folder) {
    const std::string text = read_file(fs::path(folder) / file);
    if (text.empty()) throw BackendError("CAMA_KERNELS: cannot read " + (fs::path(folder) / file).string());
    return text;
  }
  for (const EmbeddedText *t = embedded_kernels; t->name; ++t)
    if (file == t->name) return t->text;
  throw BackendError("kernel file " + file + " is not in this build");
}

/// Appends the file with its #include "..." lines replaced by the files that are not in the text yet; paths are
/// relative to the file.
void expand(const std::string &file, std::set<std::string> &expanded, std::string &out)
{
  if (!expanded.insert(file).second) return;
  const auto at = [&](int line) { out += "#line " + std::to_string(line) + " \"" + file + "\"\n"; };
  std::istringstream text(kernel_text(file));
  at(1);
  int number = 1;
  for (std::string line; std::getline(text, line); ++number) {
    if (line.rfind("#include \"", 0) == 0) {
      const std::string name = line.substr(10, line.find('"', 10) - 10);
      expand((fs::path(file).parent_path() / name).lexically_normal().generic_string(), expanded, out);
      at(number + 1);
    } else {
      out += line + "\n";
    }
  }
}

std::uint64_t hash(const std::string &text, std::uint64_t start = fnv1a(nullptr, 0))
{
  return fnv1a(text.data(), text.size(), start);
}

/// CAMA_CACHE, else the user's cache folder; empty: no cache (CAMA_CACHE=off, or no home). pocl caches compiled kernels
/// itself, and asking for a program's binary makes it compile all kernels again, so pocl has no cache here unless
/// CAMA_CACHE names a folder.
fs::path cache_folder(const Device &device)
{
  if (const char *own = std::getenv("CAMA_CACHE"); own && *own)
    return std::string(own) == "off" ? fs::path() : fs::path(own);
  if (device.driver.rfind("Portable Computing Language", 0) == 0) return {};
  if (const char *xdg = std::getenv("XDG_CACHE_HOME"); xdg && *xdg) return fs::path(xdg) / "cama";
  if (const char *home = std::getenv("HOME"); home && *home) return fs::path(home) / ".cache" / "cama";
  return {};
}

/// Some compilers ignore #line and report "<kernel>:1188:5: ..": adds the file and line that line 1188 of the whole
/// text came from.
std::string with_place(const std::string &message, const std::string &source)
{
  static const std::regex physical("^(\\s*)<(?:kernel|program source|source)>:(\\d+):");
  std::smatch match;
  if (!std::regex_search(message, match, physical)) return message;
  const int wanted = std::stoi(match[2]);
  std::istringstream text(source);
  std::string file;
  int line = 0, number = 1;
  for (std::string row; number <= wanted && std::getline(text, row); ++number) {
    std::smatch directive;
    static const std::regex form("^#line (\\d+) \"(.*)\"$");
    if (std::regex_match(row, directive, form)) {
      line = std::stoi(directive[1]) - 1;
      file = directive[2];
    } else {
      ++line;
    }
  }
  return file.empty() ? message : match[1].str() + file + ":" + std::to_string(line) + ":" + match.suffix().str();
}

/// The compiler's first errors: file, line and message.
std::string first_errors(const std::string &log, const std::string &source)
{
  std::string errors, head;
  int found = 0, lines = 0;
  std::istringstream text(log);
  for (std::string line; std::getline(text, line);) {
    if (lines++ < 10) head += "\n  " + line;
    if (line.find("error") != std::string::npos && found++ < 5) errors += "\n  " + with_place(line, source);
  }
  return errors.empty() ? head : errors;
}

const char *title(Text text)
{
  switch (text) {
  case Text::once: return "double.h";
  case Text::f32: return "real.h in single precision";
  case Text::f64: return "real.h in double precision";
  default: return "primitives.cl";
  }
}

constexpr char magic[] = "cama opencl 1\n";

}  // namespace

std::string source(Text text)
{
  std::string out;
  std::set<std::string> expanded;
  const auto add = [&](const char *file) { expand(file, expanded, out); };
  add("dialect/lang.h");
  if (text == Text::primitives) {
    add("primitives.cl");
    return out;
  }
  if (text == Text::once) {
    add("double.h");
    return out;
  }
  // real.h uses types and functions of double.h, whose kernels must not be compiled twice.
  const std::string real = text == Text::f32 ? "float" : "double";
  out += "#undef KERNEL\n#define KERNEL static inline void\n"
         "#undef TEAM_LOCAL\n#define TEAM_LOCAL(type, name, count) LOCAL type *name = 0\n";
  add("double.h");
  out += "#undef TEAM_LOCAL\n#define TEAM_LOCAL TEAM_LOCAL_MEMORY\n#undef KERNEL\n#define KERNEL __kernel "
         "void\n#define real " +
         real + "\n#define ATOMIC_ADD_REAL atomic_add_" + real + "\n";
  add("real.h");
  return out;
}

Library &Library::of(const Device &device)
{
  static std::mutex mutex;
  static auto *libraries = new std::map<cl_device_id, Library *>;
  static auto *lost = new std::vector<Library *>;  // never freed: backends may still use them
  const std::lock_guard<std::mutex> lock(mutex);
  Library *&library = (*libraries)[device.id];
  if (library && library->lost_) lost->push_back(std::exchange(library, nullptr));
  if (!library) library = new Library(device);
  return *library;
}

Library::Library(const Device &d) : device(d), is_cpu(number<cl_device_type>(d.id, CL_DEVICE_TYPE) & CL_DEVICE_TYPE_CPU)
{
  const cl_context_properties properties[] = {CL_CONTEXT_PLATFORM, reinterpret_cast<cl_context_properties>(d.platform),
                                              0};
  cl_int code = CL_SUCCESS;
  context = api().clCreateContext(properties, 1, &d.id, nullptr, nullptr, &code);
  check(code, "clCreateContext", "opening device '" + d.name + "'");
  options_ = "-cl-std=CL1.2";
  if (number<cl_device_fp_config>(d.id, CL_DEVICE_SINGLE_FP_CONFIG) & CL_FP_CORRECTLY_ROUNDED_DIVIDE_SQRT)
    options_ += " -cl-fp32-correctly-rounded-divide-sqrt";
  if (is_cpu) options_ += " -DCAMA_CHUNKED=1";
}

cl_program Library::program(Text text)
{
  const std::string whole = source(text);
  const std::lock_guard<std::mutex> lock(mutex_);
  cl_program &program = programs_[whole];
  if (program) return program;

  const fs::path folder = cache_folder(device);
  std::string file;
  if (!folder.empty()) {
    char name[40];
    const std::string key = options_ + "\n" + device.name + "\n" + device.driver + "\n" + device.version + "\n" + whole;
    std::snprintf(name, sizeof name, "%016llx%016llx.bin", static_cast<unsigned long long>(hash(key)),
                  static_cast<unsigned long long>(hash(key, 0x9e3779b97f4a7c15ull)));
    file = (folder / "opencl" / name).string();
    if ((program = load(file))) return program;
  }
  program = build(whole, title(text));
  if (!file.empty()) store(program, file);
  return program;
}

cl_program Library::build(const std::string &whole, const std::string &name)
{
  const char *text = whole.c_str();
  const size_t length = whole.size();
  cl_int code = CL_SUCCESS;
  cl_program program = api().clCreateProgramWithSource(context, 1, &text, &length, &code);
  check(code, "clCreateProgramWithSource", "kernels of " + name);
  code = api().clBuildProgram(program, 1, &device.id, options_.c_str(), nullptr, nullptr);
  if (code == CL_SUCCESS) return program;
  size_t size = 0;
  api().clGetProgramBuildInfo(program, device.id, CL_PROGRAM_BUILD_LOG, 0, nullptr, &size);
  std::string log(size, '\0');
  if (size) api().clGetProgramBuildInfo(program, device.id, CL_PROGRAM_BUILD_LOG, size, log.data(), nullptr);
  api().clReleaseProgram(program);
  throw BackendError("OpenCL: the kernels of " + name + " do not compile on device '" + device.name + "' (" +
                     device.driver + "): " + code_name(code) + first_errors(log.c_str(), whole));
}

/// A file holds the magic line, the hash of the binary and the binary. Any other file is ignored.
cl_program Library::load(const std::string &file)
{
  const std::string whole = read_file(file);
  const size_t head = sizeof magic - 1 + sizeof(std::uint64_t);
  if (whole.size() <= head || whole.compare(0, sizeof magic - 1, magic) != 0) return nullptr;
  const std::string binary = whole.substr(head);
  std::uint64_t sum;
  std::memcpy(&sum, whole.data() + sizeof magic - 1, sizeof sum);
  if (sum != hash(binary)) return nullptr;
  const auto *bytes = reinterpret_cast<const unsigned char *>(binary.data());
  const size_t size = binary.size();
  cl_int status = CL_SUCCESS, code = CL_SUCCESS;
  cl_program program = api().clCreateProgramWithBinary(context, 1, &device.id, &size, &bytes, &status, &code);
  if (code == CL_SUCCESS && status == CL_SUCCESS &&
      api().clBuildProgram(program, 1, &device.id, options_.c_str(), nullptr, nullptr) == CL_SUCCESS)
    return program;
  if (program) api().clReleaseProgram(program);
  return nullptr;
}

/// It is no error if the cache cannot be written.
void Library::store(cl_program program, const std::string &file) const
{
  size_t size = 0;
  if (api().clGetProgramInfo(program, CL_PROGRAM_BINARY_SIZES, sizeof size, &size, nullptr) != CL_SUCCESS || size == 0)
    return;
  std::string binary(size, '\0');
  auto *bytes = reinterpret_cast<unsigned char *>(binary.data());
  if (api().clGetProgramInfo(program, CL_PROGRAM_BINARIES, sizeof bytes, &bytes, nullptr) != CL_SUCCESS) return;
  std::error_code error;
  fs::create_directories(fs::path(file).parent_path(), error);
  // A unique name for every writer, also in other containers with the same process ids.
  std::string temporary = file + ".XXXXXX";
  const int descriptor = mkstemp(temporary.data());
  if (descriptor < 0) return;
  close(descriptor);
  const std::uint64_t sum = hash(binary);
  {
    std::ofstream out(temporary, std::ios::binary);
    out.write(magic, sizeof magic - 1);
    out.write(reinterpret_cast<const char *>(&sum), sizeof sum);
    out.write(binary.data(), static_cast<std::streamsize>(binary.size()));
    if (!out.flush()) {
      out.close();
      fs::remove(temporary, error);
      return;
    }
  }
  fs::rename(temporary, file, error);
  if (error) fs::remove(temporary, error);
}

}  // namespace cama::opencl
