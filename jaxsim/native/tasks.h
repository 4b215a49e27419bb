// What the functions that XLA calls share: how work is cut into tasks, and shapes.
//
// Letters as in detect/sparse.py: n rows of the input, m of the output, k cells of the kernel, c channels in, d out. All arrays
// are dense, with any number of batch dimensions first. Bounds of tasks depend on shapes alone, and no two tasks write to
// the same place: the answer is the same for any number of threads.

#pragma once

#include <algorithm>
#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>

#include "xla/ffi/api/ffi.h"

namespace ffi = xla::ffi;
using Floats = ffi::Buffer<ffi::F32>;
using Integers = ffi::Buffer<ffi::S32>;
using Numbers = ffi::Span<const int64_t>;  // of z, y, x

constexpr int64_t kBlock = 512;  // rows of a task: their sums stay in the second cache

inline int64_t Blocks(int64_t rows) { return (rows + kBlock - 1) / kBlock; }

// Runs task(0) to task(count - 1), each once, on this thread and on those of XLA's pool that are free. The calling
// thread takes tasks like the others and waits only for those that have begun, so that a full pool cannot stop it.
inline void Parallel(ffi::ThreadPool& pool, int64_t count, const std::function<void(int64_t)>& task) {
  struct Shared {
    std::atomic<int64_t> next{0};
    int64_t left;
    std::mutex mutex;
    std::condition_variable done;
  };
  const int64_t helpers = std::min(pool.num_threads(), count) - 1;
  if (helpers < 1) {
    for (int64_t i = 0; i < count; ++i) task(i);
    return;
  }
  auto shared = std::make_shared<Shared>();
  shared->left = count;
  const auto* run = &task;  // a helper that comes late finds no task left, and does not look at it
  auto work = [shared, run, count] {
    for (int64_t i; (i = shared->next.fetch_add(1)) < count;) {
      (*run)(i);
      std::lock_guard<std::mutex> lock(shared->mutex);
      if (--shared->left == 0) shared->done.notify_all();
    }
  };
  for (int64_t i = 0; i < helpers; ++i) pool.Schedule(std::function<void()>(work));
  work();
  std::unique_lock<std::mutex> lock(shared->mutex);
  shared->done.wait(lock, [&] { return shared->left == 0; });
}

// Samples, by the dimensions before an array's own.
inline int64_t Batch(ffi::Span<const int64_t> dims, size_t own) {
  int64_t count = 1;
  for (size_t i = 0; i + own < dims.size(); ++i) count *= dims[i];
  return count;
}

// A size, counted from the end.
inline int64_t Last(ffi::Span<const int64_t> dims, size_t from_the_end) { return dims[dims.size() - from_the_end]; }
