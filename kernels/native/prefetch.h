// `fetch` and `fetch_to_write`: begin to load the lines of the cache that these addresses are on.
const auto fetch = [](const auto*... addresses) { (__builtin_prefetch(addresses), ...); };
const auto fetch_to_write = [](const auto*... addresses) { (__builtin_prefetch(addresses, 1), ...); };
