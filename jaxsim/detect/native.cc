// Sparse 3D convolution on a CPU, for XLA: the functions of sparse.py that its own form there is slow at.
//
// Letters as there: n rows of the input, m of the output, k cells of the kernel, c channels in, d out. All arrays are
// dense, rows last but one, with any number of batch dimensions before them. Work is cut into tasks whose bounds depend
// on shapes alone, and no two of them write to the same place: the answer is the same for any number of threads.

#include <algorithm>
#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <cstring>
#include <functional>
#include <memory>
#include <mutex>
#include <vector>

#include "xla/ffi/api/ffi.h"

namespace ffi = xla::ffi;

namespace {

// Numbers of a vector register, and how many registers there are for sums.
#if defined(__AVX512F__)
constexpr int kLanes = 16, kRegisters = 24;
#elif defined(__AVX__)
constexpr int kLanes = 8, kRegisters = 12;
#else
constexpr int kLanes = 4, kRegisters = 12;
#endif
typedef float Vec __attribute__((vector_size(kLanes * 4), aligned(4), may_alias));

constexpr int64_t kBlock = 512;  // rows of a task: their sums stay in the second cache
constexpr int64_t kSlices = 8;   // parts of a kernel's gradient, added up in their order

inline Vec Load(const float* from) { return *reinterpret_cast<const Vec*>(from); }
inline void Store(float* to, Vec value) { *reinterpret_cast<Vec*>(to) = value; }
inline int64_t Padded(int64_t count) { return (count + kLanes - 1) / kLanes * kLanes; }

// Runs task(0) to task(count - 1), each once, on this thread and on those of XLA's pool that are free. The calling
// thread takes tasks like the others and waits only for those that have begun, so that a full pool cannot stop it.
void Parallel(ffi::ThreadPool& pool, int64_t count, const std::function<void(int64_t)>& task) {
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

// Who sees whom in a block of outputs: per kernel cell the rows of inputs and, beside them, of outputs.
struct Pairs {
  std::vector<int32_t> input, output;
  std::vector<int64_t> count;

  void Find(const int32_t* table, int64_t rows, int64_t cells, int64_t n) {
    input.resize(cells * kBlock);
    output.resize(cells * kBlock);
    count.assign(cells, 0);
    for (int64_t row = 0; row < rows; ++row) {
      for (int64_t k = 0; k < cells; ++k) {
        const int32_t from = table[row * cells + k];
        const int64_t at = k * kBlock + count[k];
        input[at] = from;
        output[at] = static_cast<int32_t>(row);
        count[k] += from >= 0 && from < n;  // what is none is written over
      }
    }
  }
};

// sum[output] += x[input] * weights, of R pairs and V vectors of outputs' channels.
template <int R, int V>
inline void AddRows(const float* const* x, float* const* sum, const float* weights, int64_t c, int64_t stride) {
  Vec total[R][V] = {};  // small sums first: less is lost by rounding than where all add to one
  for (int64_t i = 0; i < c; ++i) {
    Vec w[V];
#pragma GCC unroll 4
    for (int v = 0; v < V; ++v) w[v] = Load(weights + i * stride + v * kLanes);
#pragma GCC unroll 24
    for (int r = 0; r < R; ++r)
#pragma GCC unroll 4
      for (int v = 0; v < V; ++v) total[r][v] += x[r][i] * w[v];
  }
#pragma GCC unroll 24
  for (int r = 0; r < R; ++r)
#pragma GCC unroll 4
    for (int v = 0; v < V; ++v) Store(sum[r] + v * kLanes, Load(sum[r] + v * kLanes) + total[r][v]);
}

// All pairs of one kernel cell, R at a time; the last few are filled up with a row that nobody reads.
template <int V>
void AddCell(const float* x, int64_t c, const int32_t* input, const int32_t* output, int64_t count,
             const float* weights, int64_t d, float* sums, float* nobody) {
  constexpr int R = std::min(12, kRegisters / V);
  for (int64_t at = 0; at < count; at += R) {
    const float* from[R];
    float* to[R];
    for (int r = 0; r < R; ++r) {
      const bool is = at + r < count;
      from[r] = x + (is ? input[at + r] : input[at]) * c;
      to[r] = is ? sums + output[at + r] * d : nobody;
    }
    AddRows<R, V>(from, to, weights, c, d);
  }
}

int64_t Batch(ffi::Span<const int64_t> dims, size_t own) {
  int64_t count = 1;
  for (size_t i = 0; i + own < dims.size(); ++i) count *= dims[i];
  return count;
}

int64_t Last(ffi::Span<const int64_t> dims, size_t from_the_end) { return dims[dims.size() - from_the_end]; }

// Rows of `width` numbers as rows of `padded`, the rest 0.
void Pad(const float* from, int64_t rows, int64_t width, int64_t padded, float* to) {
  for (int64_t row = 0; row < rows; ++row) {
    std::memcpy(to + row * padded, from + row * width, width * sizeof(float));
    std::memset(to + row * padded + width, 0, (padded - width) * sizeof(float));
  }
}

// features (*b, n, c), weights (*b, k, c, d), table (*b, m, k) -> (*b, m, d)
ffi::Error Convolve(ffi::ThreadPool pool, ffi::Buffer<ffi::F32> features, ffi::Buffer<ffi::F32> weights,
                    ffi::Buffer<ffi::S32> table, ffi::ResultBuffer<ffi::F32> result) {
  const int64_t batch = Batch(features.dimensions(), 2), n = Last(features.dimensions(), 2);
  const int64_t c = Last(features.dimensions(), 1), m = Last(table.dimensions(), 2), k = Last(table.dimensions(), 1);
  const int64_t d = Last(weights.dimensions(), 1), wide = Padded(d), blocks = (m + kBlock - 1) / kBlock;
  std::vector<float> own;
  const float* kernel = weights.typed_data();
  if (wide != d) {
    own.resize(batch * k * c * wide);
    Pad(kernel, batch * k * c, d, wide, own.data());
    kernel = own.data();
  }
  Parallel(pool, batch * blocks, [&](int64_t task) {
    const int64_t sample = task / blocks, first = task % blocks * kBlock, rows = std::min(kBlock, m - first);
    static thread_local Pairs pairs;
    static thread_local std::vector<float> padded, nobody;
    pairs.Find(table.typed_data() + (sample * m + first) * k, rows, k, n);
    float* const out = result->typed_data() + (sample * m + first) * d;
    float* sums = out;
    if (wide != d) {
      padded.resize(kBlock * wide);
      sums = padded.data();
    }
    nobody.assign(wide, 0.0f);
    std::memset(sums, 0, rows * wide * sizeof(float));
    const float* const x = features.typed_data() + sample * n * c;
    for (int64_t cell = 0; cell < k; ++cell) {
      const int32_t *input = &pairs.input[cell * kBlock], *output = &pairs.output[cell * kBlock];
      const float* const w = kernel + (sample * k + cell) * c * wide;
      const auto add = [&](auto width, int64_t from) {
        AddCell<decltype(width)::value>(x, c, input, output, pairs.count[cell], w + from, wide, sums + from,
                                        nobody.data());
      };
      for (int64_t from = 0; from < wide;) {
        const int64_t vectors = std::min<int64_t>((wide - from) / kLanes, 4);
        if (vectors == 4) add(std::integral_constant<int, 4>{}, from);
        if (vectors == 3) add(std::integral_constant<int, 3>{}, from);
        if (vectors == 2) add(std::integral_constant<int, 2>{}, from);
        if (vectors == 1) add(std::integral_constant<int, 1>{}, from);
        from += vectors * kLanes;
      }
    }
    if (wide != d) {
      for (int64_t row = 0; row < rows; ++row) std::memcpy(out + row * d, sums + row * wide, d * sizeof(float));
    }
  });
  return ffi::Error::Success();
}

// sum (C x V vectors) += the outer products of pairs' rows x and change.
template <int C, int V>
inline void AddOuter(const float* x, int64_t c, const float* change, int64_t d, const int32_t* input,
                     const int32_t* output, int64_t count, float* sum) {
  Vec total[C][V] = {};
  for (int64_t pair = 0; pair < count; ++pair) {
    const float* const row = x + input[pair] * c;
    Vec y[V];
#pragma GCC unroll 4
    for (int v = 0; v < V; ++v) y[v] = Load(change + output[pair] * d + v * kLanes);
#pragma GCC unroll 8
    for (int i = 0; i < C; ++i)
#pragma GCC unroll 4
      for (int v = 0; v < V; ++v) total[i][v] += row[i] * y[v];
  }
#pragma GCC unroll 8
  for (int i = 0; i < C; ++i)
#pragma GCC unroll 4
    for (int v = 0; v < V; ++v) Store(sum + i * d + v * kLanes, Load(sum + i * d + v * kLanes) + total[i][v]);
}

// features (*b, n, c), change (*b, m, d), table (*b, m, k) -> the kernel's gradient (*b, k, c, d)
ffi::Error WeightGradient(ffi::ThreadPool pool, ffi::Buffer<ffi::F32> features, ffi::Buffer<ffi::F32> change,
                          ffi::Buffer<ffi::S32> table, ffi::ResultBuffer<ffi::F32> result) {
  const int64_t batch = Batch(features.dimensions(), 2), n = Last(features.dimensions(), 2);
  const int64_t c = Last(features.dimensions(), 1), m = Last(table.dimensions(), 2), k = Last(table.dimensions(), 1);
  const int64_t d = Last(change.dimensions(), 1), wide = Padded(d), blocks = (m + kBlock - 1) / kBlock;
  const int64_t size = k * c * wide, slices = std::clamp<int64_t>(blocks, 1, kSlices);
  std::vector<float> parts(batch * slices * size);  // zeros
  Parallel(pool, batch * slices, [&](int64_t task) {
    const int64_t sample = task / slices, slice = task % slices;
    static thread_local Pairs pairs;
    static thread_local std::vector<float> padded;
    for (int64_t block = blocks * slice / slices; block < blocks * (slice + 1) / slices; ++block) {
      const int64_t first = block * kBlock, rows = std::min(kBlock, m - first);
      pairs.Find(table.typed_data() + (sample * m + first) * k, rows, k, n);
      const float* y = change.typed_data() + (sample * m + first) * d;
      if (wide != d) {
        padded.resize(kBlock * wide);
        Pad(y, rows, d, wide, padded.data());
        y = padded.data();
      }
      for (int64_t cell = 0; cell < k; ++cell) {
        const int32_t *input = &pairs.input[cell * kBlock], *output = &pairs.output[cell * kBlock];
        float* const sum = parts.data() + task * size + cell * c * wide;
        const auto add = [&](auto high, auto width, int64_t i, int64_t from) {
          AddOuter<decltype(high)::value, decltype(width)::value>(
              features.typed_data() + sample * n * c + i, c, y + from, wide, input, output, pairs.count[cell],
              sum + i * wide + from);
        };
        const auto add_column = [&](auto width, int64_t from) {
          int64_t i = 0;
          for (; i + 4 <= c; i += 4) add(std::integral_constant<int, 4>{}, width, i, from);
          for (; i < c; ++i) add(std::integral_constant<int, 1>{}, width, i, from);
        };
        int64_t from = 0;
        if (kRegisters >= 16) {
          for (; from + 4 * kLanes <= wide; from += 4 * kLanes) add_column(std::integral_constant<int, 4>{}, from);
        }
        for (; from + 2 * kLanes <= wide; from += 2 * kLanes) add_column(std::integral_constant<int, 2>{}, from);
        for (; from < wide; from += kLanes) add_column(std::integral_constant<int, 1>{}, from);
      }
    }
  });
  for (int64_t sample = 0; sample < batch; ++sample) {
    float* const total = parts.data() + sample * slices * size;
    for (int64_t slice = 1; slice < slices; ++slice) {
      for (int64_t i = 0; i < size; ++i) total[i] += total[slice * size + i];
    }
    float* const out = result->typed_data() + sample * k * c * d;
    for (int64_t row = 0; row < k * c; ++row) std::memcpy(out + row * d, total + row * wide, d * sizeof(float));
  }
  return ffi::Error::Success();
}

// Keys of inputs (*b, n) and of outputs (*b, m), both rising -> table (*b, m, k). Attributes are numbers of z, y, x.
ffi::Error Neighbours(ffi::ThreadPool pool, ffi::Buffer<ffi::S32> inputs, ffi::Buffer<ffi::S32> outputs,
                      ffi::Span<const int64_t> shape, ffi::Span<const int64_t> out_shape,
                      ffi::Span<const int64_t> kernel, ffi::Span<const int64_t> stride,
                      ffi::Span<const int64_t> padding, ffi::ResultBuffer<ffi::S32> result) {
  const int64_t batch = Batch(inputs.dimensions(), 1), n = Last(inputs.dimensions(), 1);
  const int64_t m = Last(outputs.dimensions(), 1), blocks = (m + kBlock - 1) / kBlock;
  const int64_t lines = kernel[0] * kernel[1], cells = lines * kernel[2];
  const int64_t outside = out_shape[0] * out_shape[1] * out_shape[2];
  Parallel(pool, batch * blocks, [&](int64_t task) {
    const int64_t sample = task / blocks, first = task % blocks * kBlock, last = std::min(first + kBlock, m);
    const int32_t* const keys = inputs.typed_data() + sample * n;
    const int32_t* const end = keys + n;
    // Of each line of the kernel, how far its search has come: outputs rise, and so do the keys below them.
    std::vector<const int32_t*> at(lines, nullptr);
    for (int64_t row = first; row < last; ++row) {
      int32_t* const found = result->typed_data() + (sample * m + row) * cells;
      std::fill(found, found + cells, static_cast<int32_t>(n));
      const int64_t key = outputs.typed_data()[sample * m + row];
      if (key >= outside) continue;
      const int64_t top = key / (out_shape[1] * out_shape[2]) * stride[0] - padding[0];
      const int64_t left = key / out_shape[2] % out_shape[1] * stride[1] - padding[1];
      const int64_t x = key % out_shape[2] * stride[2] - padding[2];
      for (int64_t line = 0; line < lines; ++line) {
        const int64_t z = top + line / kernel[1], y = left + line % kernel[1];
        if (z < 0 || z >= shape[0] || y < 0 || y >= shape[1]) continue;
        const int64_t start = (z * shape[1] + y) * shape[2], low = start + std::clamp<int64_t>(x, 0, shape[2]);
        const int32_t*& here = at[line];
        if (here == nullptr) {
          here = std::lower_bound(keys, end, low);
        } else {
          while (here < end && *here < low) ++here;
        }
        const int64_t high = start + std::min(x + kernel[2], shape[2]);
        for (const int32_t* site = here; site < end && *site < high; ++site) {
          found[line * kernel[2] + (*site - start - x)] = static_cast<int32_t>(site - keys);
        }
      }
    }
  });
  return ffi::Error::Success();
}

// table (*b, m, k) of rows below n -> the other side's (*b, n, k): the output that sees an input through a cell.
ffi::Error OtherSide(ffi::ThreadPool pool, ffi::Buffer<ffi::S32> table, ffi::ResultBuffer<ffi::S32> result) {
  const int64_t batch = Batch(table.dimensions(), 2), m = Last(table.dimensions(), 2), k = Last(table.dimensions(), 1);
  const int64_t n = Last(result->dimensions(), 2);
  Parallel(pool, batch, [&](int64_t sample) {
    const int32_t* const from = table.typed_data() + sample * m * k;
    int32_t* const to = result->typed_data() + sample * n * k;
    std::fill(to, to + n * k, static_cast<int32_t>(m));
    for (int64_t row = 0; row < m; ++row) {
      for (int64_t cell = 0; cell < k; ++cell) {
        const int64_t input = from[row * k + cell];
        if (input >= 0 && input < n) to[input * k + cell] = static_cast<int32_t>(row);
      }
    }
  });
  return ffi::Error::Success();
}

// Rising, by bytes from the lowest on.
void RadixSort(std::vector<uint32_t>& keys) {
  std::vector<uint32_t> other(keys.size());
  for (int shift = 0; shift < 32; shift += 8) {
    int64_t place[257] = {0};
    for (uint32_t key : keys) ++place[(key >> shift & 255) + 1];
    for (int i = 0; i < 256; ++i) place[i + 1] += place[i];
    for (uint32_t key : keys) other[place[key >> shift & 255]++] = key;
    keys.swap(other);
  }
}

// Keys of inputs (*b, n) -> keys of a strided convolution's outputs (*b, capacity), and how many did not fit (*b).
ffi::Error StridedSites(ffi::ThreadPool pool, ffi::Buffer<ffi::S32> inputs, ffi::Span<const int64_t> shape,
                        ffi::Span<const int64_t> out_shape, ffi::Span<const int64_t> kernel,
                        ffi::Span<const int64_t> stride, ffi::Span<const int64_t> padding,
                        ffi::ResultBuffer<ffi::S32> result, ffi::ResultBuffer<ffi::S32> dropped) {
  const int64_t batch = Batch(inputs.dimensions(), 1), n = Last(inputs.dimensions(), 1);
  const int64_t capacity = Last(result->dimensions(), 1), outside = shape[0] * shape[1] * shape[2];
  Parallel(pool, batch, [&](int64_t sample) {
    std::vector<uint32_t> keys;
    keys.reserve(4 * n);
    for (int64_t row = 0; row < n; ++row) {
      const int64_t key = inputs.typed_data()[sample * n + row];
      if (key >= outside) continue;
      const int64_t place[3] = {key / (shape[1] * shape[2]), key / shape[2] % shape[1], key % shape[2]};
      int64_t low[3], high[3];  // input i is seen by outputs o with o t - p <= i < o t - p + k
      for (int axis = 0; axis < 3; ++axis) {
        const int64_t at = place[axis] + padding[axis], below = at - kernel[axis];
        low[axis] = below < 0 ? 0 : below / stride[axis] + 1;
        high[axis] = std::min(at / stride[axis], out_shape[axis] - 1);
      }
      for (int64_t z = low[0]; z <= high[0]; ++z)
        for (int64_t y = low[1]; y <= high[1]; ++y)
          for (int64_t x = low[2]; x <= high[2]; ++x)
            keys.push_back(static_cast<uint32_t>((z * out_shape[1] + y) * out_shape[2] + x));
    }
    RadixSort(keys);
    keys.erase(std::unique(keys.begin(), keys.end()), keys.end());
    const int64_t found = keys.size(), kept = std::min(found, capacity);
    int32_t* const out = result->typed_data() + sample * capacity;
    std::copy(keys.begin(), keys.begin() + kept, out);
    std::fill(out + kept, out + capacity, static_cast<int32_t>(out_shape[0] * out_shape[1] * out_shape[2]));
    dropped->typed_data()[sample] = static_cast<int32_t>(found - kept);
  });
  return ffi::Error::Success();
}

}  // namespace

using Triple = ffi::Span<const int64_t>;
using Floats = ffi::Buffer<ffi::F32>;
using Integers = ffi::Buffer<ffi::S32>;

XLA_FFI_DEFINE_HANDLER_SYMBOL(jaxsim_convolve, Convolve,
                              ffi::Ffi::Bind()
                                  .Ctx<ffi::ThreadPool>()
                                  .Arg<Floats>()
                                  .Arg<Floats>()
                                  .Arg<Integers>()
                                  .Ret<Floats>());
XLA_FFI_DEFINE_HANDLER_SYMBOL(jaxsim_weight_gradient, WeightGradient,
                              ffi::Ffi::Bind()
                                  .Ctx<ffi::ThreadPool>()
                                  .Arg<Floats>()
                                  .Arg<Floats>()
                                  .Arg<Integers>()
                                  .Ret<Floats>());
XLA_FFI_DEFINE_HANDLER_SYMBOL(jaxsim_neighbours, Neighbours,
                              ffi::Ffi::Bind()
                                  .Ctx<ffi::ThreadPool>()
                                  .Arg<Integers>()
                                  .Arg<Integers>()
                                  .Attr<Triple>("shape")
                                  .Attr<Triple>("out_shape")
                                  .Attr<Triple>("kernel")
                                  .Attr<Triple>("stride")
                                  .Attr<Triple>("padding")
                                  .Ret<Integers>());
XLA_FFI_DEFINE_HANDLER_SYMBOL(jaxsim_other_side, OtherSide,
                              ffi::Ffi::Bind().Ctx<ffi::ThreadPool>().Arg<Integers>().Ret<Integers>());
XLA_FFI_DEFINE_HANDLER_SYMBOL(jaxsim_strided_sites, StridedSites,
                              ffi::Ffi::Bind()
                                  .Ctx<ffi::ThreadPool>()
                                  .Arg<Integers>()
                                  .Attr<Triple>("shape")
                                  .Attr<Triple>("out_shape")
                                  .Attr<Triple>("kernel")
                                  .Attr<Triple>("stride")
                                  .Attr<Triple>("padding")
                                  .Ret<Integers>()
                                  .Ret<Integers>());
