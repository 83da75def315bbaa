// SPDX-License-Identifier: Apache-2.0
#undef _FORTIFY_SOURCE   // its check of longjmp allows jumps within one stack only
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

#include <csetjmp>
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

/// The first switch to a fiber is one of contexts, which calls the system twice; all others are jumps.
struct Fiber::Implementation {
  std::function<void()> work;
  ucontext_t start{}, starter{};
  jmp_buf own{}, resumer{};
  void *stack = nullptr;  // a page that traps, then stack_bytes
  std::size_t page = static_cast<std::size_t>(sysconf(_SC_PAGESIZE));
  Exceptions exceptions;
  bool finished = true, started = false;

  void enter_first()
  {
    getcontext(&start);
    start.uc_stack.ss_sp = static_cast<char *>(stack) + page;
    start.uc_stack.ss_size = stack_bytes;
    start.uc_link = nullptr;
    const auto address = static_cast<std::uint64_t>(reinterpret_cast<std::uintptr_t>(this));
    makecontext(&start, reinterpret_cast<void (*)()>(&Implementation::enter), 2,
                static_cast<unsigned int>(address >> 32), static_cast<unsigned int>(address));
    swapcontext(&starter, &start);
  }
  /// Parameters of makecontext are ints.
  static void enter(unsigned int high, unsigned int low)
  {
    auto *self =
        reinterpret_cast<Implementation *>(static_cast<std::uintptr_t>((static_cast<std::uint64_t>(high) << 32) | low));
    while (true) {
      self->work();
      self->work = nullptr;
      self->finished = true;
      if (_setjmp(self->own) == 0) _longjmp(self->resumer, 1);   // until the next work begins
    }
  }
};

bool Fiber::supported() { return true; }

Fiber::Fiber() : implementation_(std::make_unique<Implementation>())
{
  Implementation &i = *implementation_;
  void *memory =
      mmap(nullptr, i.page + stack_bytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
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
  implementation_->work = std::move(work);
  implementation_->finished = false;
}

void Fiber::resume()
{
  Implementation &i = *implementation_;
  swap_exceptions(i.exceptions);
  if (_setjmp(i.resumer) == 0) {
    if (i.started) _longjmp(i.own, 1);
    i.started = true;
    i.enter_first();
  }
  swap_exceptions(i.exceptions);
}

void Fiber::pause()
{
  Implementation &i = *implementation_;
  if (_setjmp(i.own) == 0) _longjmp(i.resumer, 1);
}

bool Fiber::finished() const { return implementation_->finished; }

}  // namespace cama

#endif
