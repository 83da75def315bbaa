// SPDX-License-Identifier: Apache-2.0
#include "device/fiber.hpp"

#include <utility>

#include "cama/error.hpp"

#if defined(_WIN32)

namespace cama {

struct Fiber::Implementation {};
Fiber::Fiber() { throw BackendError("worlds: this system has no fibers"); }
Fiber::~Fiber() = default;
bool Fiber::supported() { return false; }
void Fiber::begin(std::function<void()>) {}
void Fiber::resume() {}
void Fiber::pause() {}
bool Fiber::finished() const { return true; }

}  // namespace cama

#else

#include <cxxabi.h>
#include <sys/mman.h>
#include <ucontext.h>
#include <unistd.h>

#include <cstdint>
#include <cstring>

namespace cama {
namespace {

constexpr std::size_t stack_bytes = std::size_t(1) << 20;  // address space; memory only where it is touched

/// What the C++ runtime keeps of exceptions that are being handled (Itanium C++ ABI, 2.2.2), per thread. Each fiber
/// has its own.
struct Exceptions {
  void *caught = nullptr;
  unsigned int uncaught = 0;
};

void swap_exceptions(Exceptions &other)
{
  void *current = abi::__cxa_get_globals();
  Exceptions before;
  std::memcpy(&before, current, sizeof before);
  std::memcpy(current, &other, sizeof other);
  other = before;
}

}  // namespace

struct Fiber::Implementation {
  std::function<void()> work;
  ucontext_t own{}, resumer{};
  void *stack = nullptr;  // a page that traps, then stack_bytes
  std::size_t page = static_cast<std::size_t>(sysconf(_SC_PAGESIZE));
  Exceptions exceptions;
  bool finished = true;

  /// Parameters of makecontext are ints.
  static void enter(unsigned int high, unsigned int low)
  {
    auto *self =
        reinterpret_cast<Implementation *>(static_cast<std::uintptr_t>((static_cast<std::uint64_t>(high) << 32) | low));
    self->work();
    self->work = nullptr;
    self->finished = true;
    swapcontext(&self->own, &self->resumer);
  }
};

bool Fiber::supported() { return true; }

Fiber::Fiber() : implementation_(std::make_unique<Implementation>())
{
  Implementation &i = *implementation_;
  void *memory = mmap(nullptr, i.page + stack_bytes, PROT_READ | PROT_WRITE,
                      MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
  if (memory == MAP_FAILED) throw MemoryError("worlds: out of memory for the stack of a world; use fewer worlds");
  mprotect(memory, i.page, PROT_NONE);
  i.stack = memory;
}

Fiber::~Fiber()
{
  if (implementation_->stack) munmap(implementation_->stack, implementation_->page + stack_bytes);
}

void Fiber::begin(std::function<void()> work)
{
  Implementation &i = *implementation_;
  i.work = std::move(work);
  i.finished = false;
  i.exceptions = {};
  getcontext(&i.own);
  i.own.uc_stack.ss_sp = static_cast<char *>(i.stack) + i.page;
  i.own.uc_stack.ss_size = stack_bytes;
  i.own.uc_link = nullptr;
  const auto address = static_cast<std::uint64_t>(reinterpret_cast<std::uintptr_t>(&i));
  makecontext(&i.own, reinterpret_cast<void (*)()>(&Implementation::enter), 2, static_cast<unsigned int>(address >> 32),
              static_cast<unsigned int>(address));
}

void Fiber::resume()
{
  Implementation &i = *implementation_;
  swap_exceptions(i.exceptions);
  swapcontext(&i.resumer, &i.own);
  swap_exceptions(i.exceptions);
}

void Fiber::pause() { swapcontext(&implementation_->own, &implementation_->resumer); }

bool Fiber::finished() const { return implementation_->finished; }

}  // namespace cama

#endif
