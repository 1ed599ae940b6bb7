#pragma once

namespace lazyloc {

// Marks functions whose loops the compiler shall vectorise for the processor at hand. They must be inlined into
// RunWithAvx2 or RunWithAvx512, because a compiler uses only the instructions that the surrounding function allows.
#define LAZYLOC_ALWAYS_INLINE __attribute__((always_inline))

#if defined(__x86_64__)
template <typename Function>
__attribute__((target("avx2"))) void RunWithAvx2(const Function& function) {
  function();
}

template <typename Function>
__attribute__((target("avx512f,avx512bw,avx512vl,prefer-vector-width=512"))) void RunWithAvx512(
    const Function& function) {
  function();
}
#endif

// Runs a lambda that is LAZYLOC_ALWAYS_INLINE, with AVX2 if the processor has it. Floating-point results are the same
// without, because AVX2 alone has no fused multiplication and addition.
template <typename Function>
void RunVectorized(const Function& function) {
#if defined(__x86_64__)
  if (__builtin_cpu_supports("avx2")) return RunWithAvx2(function);
#endif
  function();
}

// Does the same with AVX-512, too, which has it: for integers.
template <typename Function>
void RunVectorizedIntegers(const Function& function) {
#if defined(__x86_64__)
  if (__builtin_cpu_supports("avx512bw") && __builtin_cpu_supports("avx512vl")) return RunWithAvx512(function);
#endif
  RunVectorized(function);
}

}  // namespace lazyloc
