// A sparse convolution and its kernel's gradient: gather and multiply, for the pairs that there are.

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <type_traits>
#include <vector>

#include "tasks.h"

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

constexpr int64_t kSlices = 8;   // parts of a kernel's gradient, added up in their order

inline Vec Load(const float* from) { return *reinterpret_cast<const Vec*>(from); }
inline void Store(float* to, Vec value) { *reinterpret_cast<Vec*>(to) = value; }
inline int64_t Padded(int64_t count) { return (count + kLanes - 1) / kLanes * kLanes; }

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

// Rows of `width` numbers as rows of `padded`, the rest 0.
void Pad(const float* from, int64_t rows, int64_t width, int64_t padded, float* to) {
  for (int64_t row = 0; row < rows; ++row) {
    std::memcpy(to + row * padded, from + row * width, width * sizeof(float));
    std::memset(to + row * padded + width, 0, (padded - width) * sizeof(float));
  }
}

// features (*b, n, c), weights (*b, k, c, d), table (*b, m, k) -> (*b, m, d)
ffi::Error Convolve(ffi::ThreadPool pool, Floats features, Floats weights,
                    Integers table, ffi::ResultBuffer<ffi::F32> result) {
  const int64_t batch = Batch(features.dimensions(), 2), n = Last(features.dimensions(), 2);
  const int64_t c = Last(features.dimensions(), 1), m = Last(table.dimensions(), 2), k = Last(table.dimensions(), 1);
  const int64_t d = Last(weights.dimensions(), 1), wide = Padded(d), blocks = Blocks(m);
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
ffi::Error WeightGradient(ffi::ThreadPool pool, Floats features, Floats change,
                          Integers table, ffi::ResultBuffer<ffi::F32> result) {
  const int64_t batch = Batch(features.dimensions(), 2), n = Last(features.dimensions(), 2);
  const int64_t c = Last(features.dimensions(), 1), m = Last(table.dimensions(), 2), k = Last(table.dimensions(), 1);
  const int64_t d = Last(change.dimensions(), 1), wide = Padded(d), blocks = Blocks(m);
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

}  // namespace

inline auto OfTwoAndTable() {
  return ffi::Ffi::Bind().Ctx<ffi::ThreadPool>().Arg<Floats>().Arg<Floats>().Arg<Integers>().Ret<Floats>();
}

XLA_FFI_DEFINE_HANDLER_SYMBOL(jaxsim_convolve, Convolve, OfTwoAndTable());
XLA_FFI_DEFINE_HANDLER_SYMBOL(jaxsim_weight_gradient, WeightGradient, OfTwoAndTable());
