/* Calls itself through another function: nobody can say how deep its stack gets. */
static volatile unsigned char left;

__attribute__((noinline)) static unsigned char down(unsigned char by);

__attribute__((noinline)) static unsigned char further(unsigned char by)
{
    return (unsigned char)(down(by) + left);
}

static unsigned char down(unsigned char by)
{
    return left > by ? (unsigned char)(further(by) + 1) : 0;
}

int main(void)
{
    return down(left);
}
