// Who sees whom: neighbour tables and the sites of strided convolutions. A site's key is (z Y + y) X + x; keys rise, and
// places without a site come last, with a key past the grid.

#include <algorithm>
#include <cstdint>
#include <utility>
#include <vector>

#include "tasks.h"

namespace {

// Keys of inputs (*b, n) and of outputs (*b, m), both rising -> table (*b, m, k). Attributes are numbers of z, y, x.
ffi::Error Neighbours(ffi::ThreadPool pool, Integers inputs, Integers outputs,
                      Numbers shape, Numbers out_shape,
                      Numbers kernel, Numbers stride,
                      Numbers padding, ffi::ResultBuffer<ffi::S32> result) {
  const int64_t batch = Batch(inputs.dimensions(), 1), n = Last(inputs.dimensions(), 1);
  const int64_t m = Last(outputs.dimensions(), 1), blocks = Blocks(m);
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
ffi::Error OtherSide(ffi::ThreadPool pool, Integers table, ffi::ResultBuffer<ffi::S32> result) {
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
ffi::Error StridedSites(ffi::ThreadPool pool, Integers inputs, Numbers shape,
                        Numbers out_shape, Numbers kernel,
                        Numbers stride, Numbers padding,
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

// What `_numbers` of detect/sparse.py gives, after the arguments.
template <typename Binding>
auto WithWindow(Binding binding) {
  return std::move(binding).template Attr<Numbers>("shape").template Attr<Numbers>("out_shape")
      .template Attr<Numbers>("kernel").template Attr<Numbers>("stride").template Attr<Numbers>("padding");
}

inline auto OfIntegers() { return ffi::Ffi::Bind().Ctx<ffi::ThreadPool>().Arg<Integers>(); }

XLA_FFI_DEFINE_HANDLER_SYMBOL(jaxsim_neighbours, Neighbours,
                              WithWindow(OfIntegers().Arg<Integers>()).Ret<Integers>());
XLA_FFI_DEFINE_HANDLER_SYMBOL(jaxsim_other_side, OtherSide, OfIntegers().Ret<Integers>());
XLA_FFI_DEFINE_HANDLER_SYMBOL(jaxsim_strided_sites, StridedSites,
                              WithWindow(OfIntegers()).Ret<Integers>().Ret<Integers>());
