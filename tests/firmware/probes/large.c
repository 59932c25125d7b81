/* Takes most of an Uno's RAM, for the check that refuses it. */
static volatile char most_of_it[1700];

int main(void)
{
    most_of_it[1] = most_of_it[0];
    return 0;
}
